"""The kinds of patterns and targets, their keys, and what a command line says of them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, cast, get_args

from pydantic.fields import FieldInfo

from labapp.console import out, print_json
from labapp.errors import UserError
from labapp.files.pattern_table import Greys, Phases, PSFPattern, Still
from labapp.files.phase_table import PhasePattern
from labapp.files.reading import FileModel, validate
from labapp.files.target_table import Shapes

_UNITS = {
    "um_per_nm": "µm a nm",
    "_nm": "nm",
    "_um": "µm",
    "_mm": "mm",
    "_m": "m",
    "_rad": "rad",
    "_deg": "°",
    "_px": "pixels",
    "_s": "s",
}


def _by_name(models: Sequence[type[FileModel]], tag: str) -> dict[str, type[FileModel]]:
    """Models by the value that their tag must have."""
    return {get_args(model.model_fields[tag].annotation)[0]: model for model in models}


PATTERNS = _by_name(get_args(Greys | Phases), "kind")
TARGETS = _by_name(get_args(Shapes), "shape")


def read_pattern(kind: str, keys: Sequence[str], wavelength_nm: float) -> Still:
    """A pattern from its kind and KEY=VALUE; UserError names what is wrong."""
    values = _values(kind, keys, PATTERNS, "pattern")
    if issubclass(PATTERNS[kind], PhasePattern):
        values = {"wavelength_nm": wavelength_nm} | values
    return cast(Still, validate({"kind": kind} | values, PATTERNS[kind], f"pattern {kind}"))


def read_psf(
    shape: str, keys: Sequence[str], wavelength_nm: float, options: Mapping[str, Any]
) -> PSFPattern:
    """The pattern whose PSF is a target, from its shape and KEY=VALUE; errors as above.

    options: of the retrieval, as a pattern's table has them; None leaves one out.
    """
    source = f"target {shape}"
    values = _values(shape, keys, TARGETS, "target")
    target = validate({"shape": shape} | values, TARGETS[shape], source)
    given = {key: value for key, value in options.items() if value is not None}
    psf = {"kind": "psf", "target": target, "wavelength_nm": wavelength_nm} | given
    return validate(psf, PSFPattern, source)


def list_patterns(*, as_json: bool) -> None:
    """Print the kinds of patterns, their keys, units and defaults."""
    if as_json:
        print_json(_described(PATTERNS, "kind", ()))
        return
    common = tuple(PhasePattern.model_fields)
    _print(_described(PATTERNS, "kind", common))
    out.print("All but constant, grating and image also have:")
    for key in _keys(PhasePattern, ()):
        out.print(f"    {key['key']:<16}{key['default']:<10}  {key['what']}", markup=False)
    out.print(
        "\nFor instance: labapp pattern lens focal_length_m=20 --out lens.png\n"
        'Lists and tables as in a plan file: terms="[[4, 0, 60], [3, 1, -40]]"',
        markup=False,
    )


def list_targets(*, as_json: bool) -> None:
    """Print the shapes of targets, their keys, units and defaults."""
    described = _described(TARGETS, "shape", ())
    if as_json:
        print_json(described)
        return
    _print(described)
    out.print("For instance: labapp retrieve spiral radius_um=120 --out spiral.png", markup=False)


def _values(
    name: str, keys: Sequence[str], models: Mapping[str, type[FileModel]], what: str
) -> dict[str, Any]:
    """KEY=VALUE, read as TOML unless the key is for text."""
    if name not in models:
        raise UserError(f"{what} {name!r} is not known. Choose one of {', '.join(models)}.")
    fields, values = models[name].model_fields, {}
    for given in keys:
        key, equals, text = given.partition("=")
        if not equals:
            raise UserError(
                f"{given!r} is no KEY=VALUE. The keys are {', '.join(_own(models[name]))}."
            )
        is_text = key in fields and fields[key].annotation is str
        values[key] = text if is_text else _as_toml(text)
    return values


def _as_toml(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _own(model: type[FileModel]) -> list[str]:
    return [key for key in model.model_fields if key not in ("kind", "shape")]


def _described(
    models: Mapping[str, type[FileModel]], tag: str, common: Sequence[str]
) -> list[dict[str, Any]]:
    return [
        {
            tag: name,
            "what": " ".join((model.__doc__ or "").split("\n\n")[0].split()),
            "keys": _keys(model, (tag, *common)),
        }
        for name, model in models.items()
    ]


def _keys(model: type[FileModel], but: Sequence[str]) -> list[dict[str, Any]]:
    return [
        {"key": key, "default": _default(field), "what": _what(key, field)}
        for key, field in model.model_fields.items()
        if key not in but
    ]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.default
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bool):
        return str(value).lower()
    return "none" if value is None or value == () else str(value)


def _what(key: str, field: FieldInfo) -> str:
    described = field.description or ""
    unit = next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")
    return f"{unit}, {described}" if unit else described


def _print(described: Sequence[Mapping[str, Any]]) -> None:
    """A kind with its keys below it: a line each, what it stands for if left out, and its unit."""
    out.print("KEY, what it is if left out, and its unit; below what they are keys of.\n")
    widest = max(len(key["key"]) for one in described for key in one["keys"])
    for one in described:
        name = one.get("kind") or one["shape"]
        out.print(f"{name}: {one['what']}", style="bold", markup=False)
        for key in one["keys"]:
            line = f"    {key['key']:<{widest}}  {key['default']:<10}  {key['what']}"
            out.print(line, markup=False)
    out.print()
