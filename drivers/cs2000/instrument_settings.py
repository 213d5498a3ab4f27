"""Check the options of a bench file, and translate them for the instrument's commands."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.option_checks import is_number, require_within

_MODE_CODES = {"normal": 0, "fast": 1, "multi": 2, "manual": 3, "multi fast": 4}
NDS = {"off": 0, "on": 1, "auto": 2}
_EXTERNAL_ND_CODES = {"none": 0, "1/10": 1, "1/100": 2}


@dataclass(frozen=True)
class InstrumentSettings:
    """Settings in the form that the commands take.

    speed: argument of SPMS, without the internal filter nd. sync: argument of SCMS. external_nd:
    argument of NDFS. lens: argument of LNSS.
    """

    speed: str
    nd: int
    sync: str
    external_nd: int
    lens: int


def settings_from_options(
    port: str,
    baudrate: int,
    *,
    mode: str,
    integration_ms: float | None,
    integration_s: int | None,
    nd: str | None,
    sync_hz: float,
    external_sync: bool,
    external_nd: str,
    close_up_lens: bool,
    rtscts: bool,
) -> InstrumentSettings:
    """Translate options for the commands; ValueError names an invalid one."""
    baudrates = (600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
    if not isinstance(port, str) or not port:
        raise ValueError(f"port is {port!r}; look it up by: labapp devices")
    if type(baudrate) is not int or baudrate not in baudrates:
        raise ValueError(f"baudrate is {baudrate!r}; choose {', '.join(map(str, baudrates))}")
    _require_one_of("mode", mode, _MODE_CODES)
    nd = ("off" if mode == "manual" else "auto") if nd is None else nd
    nds = {"off": 0, "on": 1} if mode == "manual" else NDS
    _require_one_of("nd", nd, nds)
    _require_one_of("external_nd", external_nd, _EXTERNAL_ND_CODES)
    flags = (
        ("external_sync", external_sync),
        ("close_up_lens", close_up_lens),
        ("rtscts", rtscts),
    )
    for name, value in flags:
        if not isinstance(value, bool):
            raise ValueError(f"{name} is {value!r}; give true or false")
    return InstrumentSettings(
        _spms_value(mode, integration_ms, integration_s),
        nds[nd],
        _scms_value(sync_hz, external_sync),
        _EXTERNAL_ND_CODES[external_nd],
        int(close_up_lens),
    )


def _require_one_of(name: str, value: object, known: dict[str, int]) -> None:
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} is {value!r}; choose {', '.join(known)}")


def _spms_value(mode: str, integration_ms: float | None, integration_s: int | None) -> str:
    """Return the argument of SPMS; ValueError if a time doesn't fit the mode.

    The part for the internal filter is left out.
    """
    multi = mode.startswith("multi")
    if (integration_ms is not None) != (mode == "manual"):
        raise ValueError(
            f"integration_ms is {integration_ms} and mode {mode!r}; only manual has it"
        )
    if (integration_s is not None) != multi:
        raise ValueError(
            f"integration_s is {integration_s} and mode {mode!r}; only the multi modes have it"
        )
    if integration_ms is not None:
        require_within("integration_ms", integration_ms, 5, 120_000)
        return f"{_MODE_CODES[mode]},{round(integration_ms * 1000)}"
    if integration_s is not None:
        if type(integration_s) is not int or integration_s not in range(1, 17):
            raise ValueError(f"integration_s is {integration_s}; it must be a whole 1 to 16")
        return f"{_MODE_CODES[mode]},{integration_s}"
    return str(_MODE_CODES[mode])


def _scms_value(sync_hz: float, external: bool) -> str:
    """Return the argument of SCMS, which synchronises with flickering light."""
    if not is_number(sync_hz) or (sync_hz and (external or not 20 <= sync_hz <= 200)):
        raise ValueError(
            f"sync_hz is {sync_hz} and external_sync {external}; "
            "give 20 to 200 without external_sync, or 0"
        )
    return f"1,{round(sync_hz * 100)}" if sync_hz else "2" if external else "0"
