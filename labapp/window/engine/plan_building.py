"""Plans of requested runs, in the same form as a plan file."""

from __future__ import annotations

from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from labapp.common.errors import UserError
from labapp.files.grey_table import ConstantPattern
from labapp.files.pattern_table import StillPattern
from labapp.files.plan_file import PlanFile
from labapp.files.reading import format_validation_error, validate
from labapp.window.commands import AcquireBracket, PatternTable
from labapp.window.exposure_bracket import (
    DARK_FRAMES,
    STAR_FRAMES,
    ProposedBracket,
    RequestedBracket,
    SNRBracket,
)

_NEUTRAL: PatternTable = {"kind": "constant", "grey": 0}


@cache
def _pattern() -> TypeAdapter[StillPattern]:
    """Return what validates patterns; made when it is needed, as an engine should start soon."""
    return TypeAdapter(StillPattern)


def validate_pattern(table: PatternTable) -> StillPattern:
    """Validate a pattern; raise UserError, which names the key that is wrong."""
    try:
        return _pattern().validate_python(table)
    except ValidationError as error:
        raise UserError(format_validation_error(error, "pattern")) from error


def build_bracket_plan(request: AcquireBracket) -> PlanFile:
    """Build the plan of an exposure bracket.

    The plan has dark frames at every exposure time, then star and photograph, each with the neutral
    and the requested pattern. Raises UserError if the request isn't valid.
    """
    pattern = validate_pattern(request.pattern)
    if isinstance(pattern, ConstantPattern):
        raise UserError("A constant grey codes nothing. Choose another pattern, then acquire.")
    coded = pattern.label
    patterns = {"neutral": _NEUTRAL, coded: request.pattern}
    wavelengths = [round(request.wavelength * 1e9, 3)]
    # An exposure time of both brackets needs its dark frames only once.
    every = list(dict.fromkeys([*request.star.exposures_ms, *request.photograph.exposures_ms]))

    def block(target: str, shown: list[str], **keys: Any) -> dict[str, Any]:
        return {
            "targets": [target],
            "patterns": shown,
            "wavelengths_nm": wavelengths,
            **keys,
        }

    def light(target: str, bracket: RequestedBracket, repeats: int) -> dict[str, Any]:
        return block(target, list(patterns), **_exposure_keys(bracket, repeats))

    dark = block("dark", ["neutral"], exposures_ms=every, repeats=DARK_FRAMES, role="dark")
    table = {
        "version": 1,
        "title": f"Bracket: {coded}",
        "seed": 1,
        "patterns": patterns,
        "acquire": [
            *([dark] if every else []),
            light("star", request.star, STAR_FRAMES),
            light("photograph", request.photograph, 1),
        ],
        "reconstruct": {"coded": coded},
    }
    return validate(table, PlanFile, "bracket")


def _exposure_keys(bracket: RequestedBracket, repeats: int) -> dict[str, Any]:
    """Return the keys of a block for a bracket.

    Exposures that are to be chosen have their dark frames in the block. Those, and proposed ones,
    have no repeats: the ratio is that of all frames.
    """
    if isinstance(bracket, SNRBracket):
        return {
            "bracket": {"snr_db": bracket.snr_db, "decades": bracket.decades},
            "interleave": [{"role": "dark", "frames": DARK_FRAMES}],
        }
    if isinstance(bracket, ProposedBracket):
        repeats = 1
    return {"exposures_ms": list(bracket.exposures_ms), "repeats": repeats}
