"""Choose the SLM's output: the one that was named, and never the operator's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.x11.outputs import Output


@dataclass(frozen=True)
class ScreenRequest:
    """What is wanted for the SLM.

    screen: an output's name, or a monitor's model or serial number; any screen of that size if
    empty. width, height: pixels. allowed: names of properties that aren't checked.
    """

    screen: str
    width: int
    height: int
    refresh_hz: float
    allow_primary: bool
    allowed: Sequence[str] = ()


NATIVE_SIZE = "native size"
"""Name, among the properties that may be allowed, of the size that a monitor tells of itself."""


def choose_screen(request: ScreenRequest, outputs: Sequence[Output]) -> Output:
    """Choose the output that fits the request; otherwise DeviceError lists all of them."""
    found = [output for output in outputs if _matches_request(request, output)]
    if request.screen:
        what = f"no screen is called {request.screen!r}"
        many = f"several screens are called {request.screen!r}"
    else:
        what = f"no screen has {request.width}x{request.height} pixels"
        if not request.allow_primary:
            what += " but the operator's"
        many = f"several screens have {request.width}x{request.height} pixels"
    if not found:
        remedy = "Plug it in, switch it on, and extend the desktop to it (xrandr --auto)"
        raise _error(request, what, remedy, outputs)
    if len(found) > 1:
        remedy = "Give screen an output's name, or the monitor's serial number"
        raise _error(request, many, remedy, outputs)
    _require_fit(request, found[0], outputs)
    return found[0]


def _matches_request(wanted: ScreenRequest, output: Output) -> bool:
    if not wanted.screen:
        return (output.width, output.height) == (wanted.width, wanted.height) and (
            wanted.allow_primary or not output.primary
        )
    monitor = output.monitor
    names = (output.name, monitor.model, monitor.serial, f"{monitor.model} {monitor.serial}")
    return wanted.screen.strip().casefold() in {n.strip().casefold() for n in names if n.strip()}


def _require_fit(wanted: ScreenRequest, output: Output, there: Sequence[Output]) -> None:
    if output.primary and not wanted.allow_primary:
        only = "the only screen" if len(there) == 1 else "the operator's own (primary) screen"
        remedy = "Choose another, or write allow_primary = true to have it covered all the same"
        raise _error(wanted, f"{output.name} is {only}", remedy, there)
    if (output.width, output.height) != (wanted.width, wanted.height):
        what = f"{output.name} runs at {output.width}x{output.height} pixels"
        remedy = f"xrandr --output {output.name} --mode {wanted.width}x{wanted.height}"
        raise _error(wanted, what, remedy, there)
    # A relative difference of 0.01 is allowed, because 59.94 Hz is sold as 60 Hz.
    if output.refresh and abs(output.refresh / wanted.refresh_hz - 1) > 0.01:
        what = f"{output.name} runs at {output.refresh:.2f} Hz, not {wanted.refresh_hz:g}"
        remedy = f"xrandr --output {output.name} --rate {wanted.refresh_hz:g}, or say refresh_hz"
        raise _error(wanted, what, remedy, there)
    if output.distortion:
        what = f"{output.name} doesn't show its pixels as they are: {output.distortion}"
        remedy = (
            f"xrandr --output {output.name} --panning 0x0 --mode {wanted.width}x{wanted.height} "
            "--scale 1 --rotate normal --reflect normal"
        )
        raise _error(wanted, what, remedy, there)
    size = (output.width, output.height)
    if all(output.native) and output.native != size and NATIVE_SIZE not in wanted.allowed:
        columns, rows = output.native
        what = (
            f"{output.name} is sent {size[0]}x{size[1]} pixels, and the monitor says that it has "
        )
        what += f"{columns}x{rows}: it scales the picture"
        remedy = (
            f"xrandr --output {output.name} --mode {columns}x{rows}, and say width and height; "
        )
        remedy += f'or write allow_properties = ["{NATIVE_SIZE}"] if the panel has other pixels'
        raise _error(wanted, what, remedy, there)
    for other in there:
        if other.name != output.name and output.overlaps(other):
            what = f"{output.name} shows what {other.name} shows, too"
            remedy = "Extend the desktop to it instead of mirroring"
            raise _error(wanted, what, remedy, there)


def _error(wanted: ScreenRequest, what: str, remedy: str, there: Sequence[Output]) -> DeviceError:
    listed = "; ".join(map(str, there)) or "none"
    model = wanted.screen or f"a screen of {wanted.width}x{wanted.height}"
    return DeviceError(model, "find the screen", f"{what} (screens: {listed})", remedy)
