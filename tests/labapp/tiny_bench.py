"""The small bench made tiny: its pictures take milliseconds whatever is computed."""

from __future__ import annotations

_CHANGES = {
    "width = 192": "width = 48",
    "height = 108": "height = 36",
    "f_number = 5.0": "f_number = 40.0",
    "width = 96": "width = 45",
    "height = 64": "height = 40",
    "pitch_um = 3.45": "pitch_um = 14.0",
}

SHAPE = (40, 45)
PANEL_SHAPE = (36, 48)
FULL_WELL = 10500.0


def make_tiny(small):
    """Change the bench file in place; its sensor and panel have SHAPE and PANEL_SHAPE."""
    text = small.bench.read_text()
    for old, new in _CHANGES.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    small.bench.write_text(text)
    scene = small.scene.read_text()
    small.scene.write_text(scene.replace("radiance = 5.0", "radiance = 5000.0"))
    return small
