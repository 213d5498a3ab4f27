"""What several tests of plans share: a bench's abilities, and a plan of one or more blocks."""

from __future__ import annotations

from typing import Any

from labapp.files.plan_file import PlanFile
from labapp.runs.capabilities import BenchCapabilities

PATTERNS: dict[str, Any] = {
    "neutral": {"kind": "constant"},
    "lens": {"kind": "lens", "focal_length_m": 50.0},
    "grey": {"kind": "constant", "grey": 100},
    "two": {"kind": "video", "frames": ["neutral", "grey"]},
    "three": {"kind": "video", "frames": ["neutral", "grey", "lens"]},
}


def abilities(**changes: Any) -> BenchCapabilities:
    """Of a wheel of four filters, the last two alike, and a 60 Hz panel."""
    settings: dict[str, Any] = {
        "targets": ("dark", "star", "photograph", "flat"),
        "by_hand": False,
        "wavelength_range": (450e-9, 633e-9),
        "slots": (450e-9, 532e-9, 633e-9, 633e-9),
        "exposure_range": (20e-6, 30.0),
        "frame_shape": (64, 96),
        "panel_shape": (108, 192),
        "video_frame": 1 / 60,
        "readout": 0.008,
        "target_settling": 0.5,
        "slm_settling": 0.05,
        "filter_settling": 0.2,
    }
    return BenchCapabilities(**settings | changes)


def tunable(**changes: Any) -> BenchCapabilities:
    """Of a tunable filter from 420 to 720 nm."""
    return abilities(**{"slots": (), "wavelength_range": (420e-9, 720e-9)} | changes)


def block(**changes: Any) -> dict[str, Any]:
    """One frame of a star; None leaves a key out."""
    keys = {
        "targets": ["star"],
        "patterns": ["neutral"],
        "wavelengths_nm": [532],
        "exposures_ms": [1],
    } | changes
    return {key: value for key, value in keys.items() if value is not None}


def plan_of(*blocks: dict[str, Any], **keys: Any) -> PlanFile:
    plan = {"version": 1, "title": "Plan", "patterns": PATTERNS, "acquire": list(blocks)}
    return PlanFile.model_validate(plan | keys)
