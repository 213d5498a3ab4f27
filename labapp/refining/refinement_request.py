"""The request for a refinement, completed by what a bench knows of its star."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, ValidationError

from labapp.bench.opening import Bench
from labapp.bench.star_target import require_star_target
from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_list
from labapp.files.quantities import Positive
from labapp.files.reading import FileModel, format_validation_error
from optics.camera.pupil import panel_to_focus_distance


class RefinementRequest(FileModel):
    """The options of `labapp refine`.

    pictures: of the PSF. The first shows the start; the last is only evaluated.
    exposures_ms: bracket of each picture. Those of a video are rounded up to whole periods.
    star, dark: names of the targets. dark may be "" if the lamp can't be covered.
    star_um, star_m: diameter and distance of the pinhole. By default they are the scene's.
    """

    pictures: Annotated[int, Field(ge=2, le=1000)] = 5
    exposures_ms: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0, 8.0, 64.0)
    star: str = "star"
    dark: str = "dark"
    star_um: Positive | None = None
    star_m: Positive | None = None

    @staticmethod
    def from_options(**words: object) -> RefinementRequest:
        """Check options; raise UserError with the one that is wrong."""
        try:
            return RefinementRequest.model_validate(words)
        except ValidationError as error:
            raise UserError(format_validation_error(error, "refine")) from error


def parse_milliseconds(text: str) -> list[float]:
    """Parse exposures in milliseconds, such as "1,8,64"."""
    try:
        return parse_list(text)
    except ValueError as error:
        raise UserError(
            f"--exposures-ms {text}: give milliseconds with commas or semicolons between, as in "
            f"1,8,64: {error}."
        ) from error


def with_star_size(request: RefinementRequest, bench: Bench) -> RefinementRequest:
    """Complete a request by the diameter and the distance of the bench's star.

    Values that the request already has stay as they are. Raises UserError if the bench lacks a
    target, or if the diameter isn't known.
    """
    table = require_star_target(bench, request.star, request.dark)
    known = {"star_m": panel_to_focus_distance(bench.description)}
    if table is not None:
        known = {"star_um": table.diameter_um, "star_m": table.distance_m}
    given = {key: value for key, value in request.model_dump().items() if value is not None}
    filled = RefinementRequest.from_options(**(known | given))
    if filled.star_um is None:
        raise UserError(
            "the camera sees the PSF as wide as the star's image: give the diameter of the pinhole "
            "with --star-um."
        )
    return filled
