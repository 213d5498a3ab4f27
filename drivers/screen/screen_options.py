"""Check the SLM's options before its screen is looked for."""

from __future__ import annotations

from dataclasses import replace

from drivers.option_checks import require_names, require_within
from drivers.screen.screen_choice import ScreenRequest


def check_options(
    request: ScreenRequest, *, display: str | None, settling_ms: float, allow_ramp: bool
) -> ScreenRequest:
    """Return the request with its fields in the right types; ValueError names a wrong option."""
    if not isinstance(request.screen, str):
        raise ValueError(f"screen is {request.screen!r}; give a name in quotes")
    for name, size in (("width", request.width), ("height", request.height)):
        if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= 32767:
            raise ValueError(f"{name} is {size!r}; give pixels, from 1 to 32767")
    require_within("refresh_hz", request.refresh_hz, 1, 1000)
    require_within("settling_ms", settling_ms, 0, 1e6)
    if display is not None and (not isinstance(display, str) or ":" not in display):
        raise ValueError(f"display is {display!r}; write it as in DISPLAY, such as ':0'")
    for name, word in (("allow_primary", request.allow_primary), ("allow_ramp", allow_ramp)):
        if not isinstance(word, bool):
            raise ValueError(f"{name} is {word!r}; write true or false")
    allowed = require_names("allow_properties", request.allowed)
    return replace(request, refresh_hz=float(request.refresh_hz), allowed=allowed)
