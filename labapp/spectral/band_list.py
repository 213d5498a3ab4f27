"""The option --bands: a list of wavelengths in nanometres. The module loads nothing slow."""

from __future__ import annotations

from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_number, split_list
from labapp.files.wavelengths import guess_unit

ALL = "all"
"""Word for all recorded bands."""

_EXAMPLE = "Write nanometres with commas between, as in 450,500,550, or all"


def parse_bands(text: str) -> tuple[float, ...] | None:
    """Parse the option --bands: metres, rising, from nanometres in any order; None for "all".

    Raises UserError for anything else, numbers in another unit, a band that stands there twice, or
    fewer than two bands.
    """
    if text.strip().lower() == ALL:
        return None
    try:
        numbers = [parse_number(one, "nm") for one in split_list(text) if one.strip()]
    except ValueError as error:
        raise UserError(f"--bands {text}: isn't a list of numbers. {_EXAMPLE}: {error}.") from error
    unit = guess_unit(numbers)
    if unit != "nanometres":
        hint = f"in {unit}? {_EXAMPLE}" if unit else f"no visible light in nanometres. {_EXAMPLE}"
        raise UserError(f"--bands {text}: {hint}.")
    if len(set(numbers)) < len(numbers):
        raise UserError(f"--bands {text}: names a band twice. Name each once.")
    if len(numbers) < 2:
        raise UserError(
            f"--bands {text}: is one band. Name two or more; one is restored by --wavelength-nm."
        )
    return tuple(sorted(one / 1e9 for one in numbers))
