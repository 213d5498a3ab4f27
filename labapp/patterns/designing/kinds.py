"""What the command line asks of a pattern's design: its kind and KEY=VALUE texts, and options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from labapp.common.errors import UserError
from labapp.common.list_output import ListEntry, print_list
from labapp.files.key_values import describe_keys, parse_key_values
from labapp.files.pattern_table import STILL_PATTERNS, PSFPattern, StillPattern, VideoPattern
from labapp.files.phase_table import PhasePattern
from labapp.files.reading import validate
from labapp.files.table import Table, tag_value
from labapp.files.target_table import TARGET_SHAPES

TARGETS = {tag_value(one, "shape"): one for one in TARGET_SHAPES}
_TAGS = ("kind", "shape")


@dataclass(frozen=True)
class DesignRequest:
    """The options of `labapp pattern` and `labapp retrieve`.

    wavelength: in metres, at which the PSF is predicted. frames: of a video; 1 for a still pattern.
    side: of the PSF in sensor pixels; None takes the size that the target needs. Raises UserError
    for a pattern that can't be a video.
    """

    pattern: StillPattern
    wavelength: float
    frames: int
    seed: int
    bench: Path | None
    side: int | None

    def __post_init__(self) -> None:
        # A video that can't be is refused before anything is computed.
        _ = self.plan_pattern

    @cached_property
    def plan_pattern(self) -> StillPattern | VideoPattern:
        """The same pattern as a plan file has it."""
        if self.frames == 1:
            return self.pattern
        video = {"kind": "video", "pattern": self.pattern, "count": self.frames}
        return validate(video, VideoPattern, f"{self.frames} frames")


def read_pattern(kind: str, keys: Sequence[str], wavelength_nm: float) -> StillPattern:
    """Read what to design from its kind and KEY=VALUE texts; UserError if one is wrong."""
    values = _values(kind, keys, STILL_PATTERNS, "pattern")
    if issubclass(STILL_PATTERNS[kind], PhasePattern):
        values = {"wavelength_nm": wavelength_nm} | values
    return validate({"kind": kind} | values, STILL_PATTERNS[kind], f"pattern {kind}")


def read_psf(
    shape: str, keys: Sequence[str], wavelength_nm: float, options: Mapping[str, Any]
) -> PSFPattern:
    """Read a PSF to design from its target's shape and KEY=VALUE texts.

    options: keys for the phase retrieval; None leaves one out.
    Raises UserError if a key is wrong.
    """
    source = f"target {shape}"
    values = _values(shape, keys, TARGETS, "target")
    target = validate({"shape": shape} | values, TARGETS[shape], source)
    given = {key: value for key, value in options.items() if value is not None}
    psf = {"kind": "psf", "target": target, "wavelength_nm": wavelength_nm} | given
    return validate(psf, PSFPattern, source)


def list_patterns(*, as_json: bool) -> None:
    """Print the kinds that can be designed, with their keys, units and defaults."""
    print_list(
        _list_entries(STILL_PATTERNS),
        as_json=as_json,
        common_keys=describe_keys(PhasePattern),
        example="labapp pattern lens focal_length_m=20 --out lens.png\n"
        'Lists and tables as in a plan file: terms="[[4, 0, 60], [3, 1, -40]]"',
    )


def list_targets(*, as_json: bool) -> None:
    """Print the target shapes, with their keys, units and defaults."""
    example = "labapp retrieve spiral radius_um=120 --out spiral.png"
    print_list(_list_entries(TARGETS), as_json=as_json, example=example)


def _values(
    name: str, keys: Sequence[str], tables: Mapping[str, type[Table]], what: str
) -> dict[str, Any]:
    """Parse the KEY=VALUE texts of a kind; UserError if there is no such kind."""
    if name not in tables:
        raise UserError(f"{what} {name!r} is not known. Choose one of {', '.join(tables)}.")
    return parse_key_values(keys, tables[name], _TAGS)


def _list_entries(tables: Mapping[str, type[Table]]) -> list[ListEntry]:
    """Return the entries, each with the first paragraph of its docstring in one line."""
    return [
        ListEntry(
            name,
            " ".join((one.__doc__ or "").split("\n\n")[0].split()),
            describe_keys(one, _TAGS),
        )
        for name, one in tables.items()
    ]
