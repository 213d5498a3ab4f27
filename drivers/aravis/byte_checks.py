"""Find frames whose bytes can't be what the pixel format says.

What is told apart: bytes in another order, words justified left, layouts of packed formats taken
for each other, and lines with padding that the camera doesn't tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.arrivals import BadFrame
from drivers.aravis.pixel_formats import PixelFormat, unpack


@dataclass(frozen=True)
class ByteLimits:
    """Set from when on a frame's bytes count as impossible.

    evidence_bits: bits that must be zero by chance in a sound frame; 24 are one in 1e7. Chosen.
    several: pixels that must differ from most others, so that it isn't for hot pixels. Chosen.
    sample: pixels in the middle rows that are read in other ways. Chosen, for 2 ms a frame.
    rougher_bits: bits by which neighbours across or down may differ more than in another reading of
    the bytes, and by a quarter of which the others. Chosen: sound pictures are smoother, or as
    rough if they are white noise.
    compared: pixels that differ from their neighbours, from which on that is judged. Chosen.
    padding: most pixels, or bytes, of padding after a line that are looked for. Chosen; lines are
    padded to multiples of 4 to 64 bytes.
    """

    evidence_bits: int = 24
    several: int = 16
    sample: int = 1 << 16
    rougher_bits: float = 1.1
    compared: int = 64
    padding: int = 64


_LIMITS = ByteLimits()

WIDER = "Give a roi whose lines need no padding, such as a width that is a multiple of 64"

_FORMAT = "Choose another pixel format, and ask the camera's maker"


def require_possible_numbers(image: NDArray[np.uint16], form: PixelFormat) -> None:
    """Raise BadFrame if the pixels can't be numbers of their format."""
    _require_range(image, form)
    _require_low_bits(image, form)


def require_possible_layout(
    data: NDArray[np.uint8], image: NDArray[np.uint16], form: PixelFormat
) -> None:
    """Raise BadFrame if the bytes can't stand as the pixel format says.

    image: the pixels as they were unpacked.
    """
    _require_zero_bits(data, form)
    _require_smoothness(data, image.shape, form)
    _require_straight_columns(data, image, form)


def proven_step(image: NDArray[np.uint16]) -> int:
    """Return the power of two of which all numbers are multiples; 1 if that may be by chance."""
    bits = _zero_bits(image)
    numbers = np.count_nonzero(np.bincount(image.reshape(-1))[1:])
    return 1 << bits if numbers * bits >= _LIMITS.evidence_bits else 1


def _zero_bits(image: NDArray[np.uint16]) -> int:
    """Return how many of the lowest bits are zero in all pixels."""
    used = int(np.bitwise_or.reduce(image, axis=None))
    return (used & -used or 1).bit_length() - 1


def _impossible(words: str, remedy: str) -> BadFrame:
    return BadFrame("impossible", words, remedy)


def _require_range(image: NDArray[np.uint16], form: PixelFormat) -> None:
    """Raise BadFrame if pixels exceed the full scale, and tell why by the bits that are zero."""
    top = int(image.max())
    if top <= form.full_scale:
        return
    swapped, least = image.byteswap(), 16 - form.bits
    causes = []
    if int(swapped.max()) <= form.full_scale:
        causes.append(_other_order(form))
    if _zero_bits(image) >= least:
        causes.append(_LEFT)
    elif _zero_bits(swapped) >= least:
        causes.append(_both(_other_order(form), _LEFT))
    words = f"its pixels reach {top}, and {form.name} ends at {form.full_scale}: it is "
    if not causes:
        raise _impossible(f"{words}another format than it tells", _FORMAT)
    raise _impossible(words + " or ".join(words for words, _ in causes), _choice(causes))


def _require_low_bits(image: NDArray[np.uint16], form: PixelFormat) -> None:
    """Raise BadFrame if one end of a dim frame's words stays empty although the pixels differ."""
    if form.layout != "words" or form.bits == 16 or form.justification:
        return
    bits = _zero_bits(image)
    if bits < 16 - form.bits:
        return
    counts = np.bincount(image.reshape(-1))
    numbers = np.count_nonzero(counts[1:])
    several = image.size - int(counts.max()) >= _LIMITS.several
    if numbers * bits < _LIMITS.evidence_bits and not several:
        return
    causes = [_other_order(form), _LEFT] if bits >= 8 else [_LEFT]
    causes.append((f"of a converter of {form.bits - bits} bits", 'justification = "right"'))
    raise _impossible(
        f"its pixels have {numbers} numbers above 0, all of them multiples of {1 << bits}: it is "
        f"{' or '.join(words for words, _ in causes)}",
        _choice(causes),
    )


_LEFT = ("justified left", 'justification = "left"')


def _other_order(form: PixelFormat) -> tuple[str, str]:
    order = "little" if form.byte_order == "big" else "big"
    return f"{order}-endian", f'byte_order = "{order}"'


def _both(first: tuple[str, str], second: tuple[str, str]) -> tuple[str, str]:
    return f"{first[0]} and {second[0]}", f"{first[1]} and {second[1]}"


def _choice(causes: list[tuple[str, str]]) -> str:
    """Say which options would read the frames right."""
    return f"Give {', or '.join(option for _, option in causes)} in the camera's options"


def _require_zero_bits(data: NDArray[np.uint8], form: PixelFormat) -> None:
    if form.layout == "packed" and form.bits == 10:
        if np.bitwise_or.reduce(data[1::3], initial=np.uint8(0)) & 0xCC:
            raise _impossible(f"bits that {form.name} leaves zero are set", _FORMAT)
    elif form.shift:
        order = ">u2" if form.byte_order == "big" else "<u2"
        if int(np.bitwise_or.reduce(data.view(order), axis=None)) & (1 << form.shift) - 1:
            words = (
                f"the lowest {form.shift} bits of its words aren't zero: it isn't justified left"
            )
            raise _impossible(words, "Leave the camera's option justification out")


def _require_smoothness(data: NDArray[np.uint8], shape: tuple[int, ...], form: PixelFormat) -> None:
    """Raise BadFrame if another reading of the bytes makes a smoother picture."""
    line = form.byte_count((1, shape[1]))
    if min(shape) < 8 or shape[1] % form.group:
        return
    rows = min(shape[0], max(8, _LIMITS.sample // shape[1]))
    first = (shape[0] - rows) // 2
    part, size = data[first * line : (first + rows) * line], (rows, shape[1])
    told = unpack(part, form, size)
    # Eight bits in the upper byte read the same as dim ones in the wrong byte.
    if form.layout == "words" and not int(np.bitwise_or.reduce(told, axis=None)) & 255:
        return
    for name, remedy, other in _other_readings(part, told, form):
        if _is_rougher(told, other.reshape(size), 2 if form.bayer else 1):
            raise _impossible(f"its picture is smoother if its bytes are read as {name}", remedy)


def _other_readings(
    part: NDArray[np.uint8], told: NDArray[np.uint16], form: PixelFormat
) -> list[tuple[str, str, NDArray[np.uint16]]]:
    """Return other readings of the bytes: name, remedy, pixels."""
    if form.layout == "words":
        name, option = _other_order(form)
        remedy = f"Give {option} in the camera's options"
        return [] if form.shift else [(name, remedy, told.byteswap())]
    size = (1, told.size)
    if form.layout == "packed" and form.bits == 12:
        twin = form.name.replace("Packed", "p")
        return [(twin, _FORMAT, unpack(part, replace(form, layout="p"), size))]
    if form.layout != "p":
        return []
    bits = np.unpackbits(part).reshape(-1, form.bits)
    weights = 1 << np.arange(form.bits - 1, -1, -1)
    other = (bits @ weights).astype(np.uint16)
    found = [("a stream with the most significant bit first", _FORMAT, other)]
    if form.bits == 12:
        twin = form.name.replace("p", "Packed")
        found.append((twin, _FORMAT, unpack(part, replace(form, layout="packed"), size)))
    return found


def _is_rougher(told: NDArray[np.uint16], other: NDArray[np.uint16], apart: int) -> bool:
    """Return whether neighbours differ by far more in one reading of a frame than in the other.

    apart: pixels between neighbours of the same colour.
    """
    ratios = []
    for axis in (0, 1):
        first, second = _differences(told, axis, apart), _differences(other, axis, apart)
        differ = (first > 0) | (second > 0)
        if np.count_nonzero(differ) < _LIMITS.compared:
            return False
        first, second = first[differ], second[differ]
        # Logarithms weigh noise more than edges do; both must tell the same.
        logarithms = np.log2(1.0 + first).mean() - np.log2(1.0 + second).mean()
        means = np.log2((first.mean() + 1e-3) / (second.mean() + 1e-3))
        ratios.append(float(min(logarithms, means)))
    return max(ratios) > _LIMITS.rougher_bits and min(ratios) > _LIMITS.rougher_bits / 4


def _differences(image: NDArray[np.uint16], axis: int, apart: int) -> NDArray[np.int32]:
    """Return how much pixels differ from their neighbours of the same colour."""
    m = image.astype(np.int32)
    return np.abs(m[apart:] - m[:-apart] if axis == 0 else m[:, apart:] - m[:, :-apart])


def _require_straight_columns(
    data: NDArray[np.uint8], image: NDArray[np.uint16], form: PixelFormat
) -> None:
    """Raise BadFrame if lines run on into padding of equal numbers."""
    rows, columns = image.shape
    if rows < 16 or columns < 16 or columns % form.group:
        return
    flat = image.reshape(-1) if form.layout == "words" else data
    unit = "pixels" if form.layout in ("words", "bytes") else "bytes"
    line = flat.size // rows
    value, after = flat[line], flat[line : line + _LIMITS.padding]
    run = int(np.argmax(np.append(after != value, True)))
    for length in range(run, 0, -1):
        count = (flat.size - line - length) // (line + length) + 1
        starts = line + np.arange(count) * (line + length)
        if count < 8 or not np.all(flat[starts] == value):
            continue
        padding = starts[:, None] + np.arange(length)
        others = np.count_nonzero(flat == value) - padding.size
        if others <= 0.1 * (flat.size - padding.size) and np.all(flat[padding] == value):
            words = (
                f"one number comes again every {line + length} {unit}: its lines of {line} have "
            )
            words += f"{length} of padding that the camera doesn't tell"
            raise _impossible(words, WIDER)
