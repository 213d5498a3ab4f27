"""Plans of runs that the window requests, in the same form as a plan file."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter, ValidationError

from labapp.common.errors import UserError
from labapp.files.grey_table import ConstantPattern
from labapp.files.pattern_table import StillPattern
from labapp.files.plan_file import PlanFile
from labapp.files.reading import format_validation_error, validate
from labapp.window.exposure_bracket import DARK_FRAMES, STAR_FRAMES
from labapp.window.messages import AcquireBracket, PatternTable

_NEUTRAL: PatternTable = {"kind": "constant", "grey": 0}

_pattern: TypeAdapter[StillPattern] = TypeAdapter(StillPattern)


def validate_pattern(table: PatternTable) -> StillPattern:
    """Validate a pattern from the window; raise UserError, which names the key that is wrong."""
    try:
        return _pattern.validate_python(table)
    except ValidationError as error:
        raise UserError(format_validation_error(error, "pattern")) from error


def build_bracket_plan(request: AcquireBracket) -> PlanFile:
    """Build the plan of an exposure bracket that the window requests.

    The plan has dark frames at every exposure time, then star and photograph, each with the
    neutral and the requested pattern. Raises UserError if the request isn't valid.
    """
    pattern = validate_pattern(request.pattern)
    if isinstance(pattern, ConstantPattern):
        raise UserError("A constant grey codes nothing. Choose another pattern, then acquire.")
    coded = pattern.label
    patterns = {"neutral": _NEUTRAL, coded: request.pattern}
    wavelengths = [round(request.wavelength * 1e9, 3)]
    exposures = {"star": request.star.exposures_ms, "photograph": request.photograph.exposures_ms}
    # An exposure time of both brackets needs its dark frames only once.
    every = list(dict.fromkeys([*exposures["star"], *exposures["photograph"]]))

    def block(target: str, shown: list[str], times: Any, repeats: int) -> dict[str, Any]:
        return {
            "targets": [target],
            "patterns": shown,
            "wavelengths_nm": wavelengths,
            "exposures_ms": list(times),
            "repeats": repeats,
        }

    table = {
        "version": 1,
        "title": f"Bracket: {coded}",
        "seed": 1,
        "patterns": patterns,
        "acquire": [
            block("dark", ["neutral"], every, DARK_FRAMES) | {"role": "dark"},
            block("star", list(patterns), exposures["star"], STAR_FRAMES),
            block("photograph", list(patterns), exposures["photograph"], 1),
        ],
        "reconstruct": {"coded": coded},
    }
    return validate(table, PlanFile, "bracket")
