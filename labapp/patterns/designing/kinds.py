"""The kinds of patterns and targets, their keys, and what a command line says of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast, get_args

from labapp.common.console import out, print_json
from labapp.common.errors import UserError
from labapp.files.keys import described_keys, read_keys
from labapp.files.pattern_table import Greys, Phases, PSFPattern, Still
from labapp.files.phase_table import PhasePattern
from labapp.files.reading import FileModel, validate
from labapp.files.target_table import Shapes


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
    for key in described_keys(PhasePattern):
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
    """KEY=VALUE of a kind that is known."""
    if name not in models:
        raise UserError(f"{what} {name!r} is not known. Choose one of {', '.join(models)}.")
    return read_keys(keys, models[name], ("kind", "shape"))


def _described(
    models: Mapping[str, type[FileModel]], tag: str, common: Sequence[str]
) -> list[dict[str, Any]]:
    return [
        {
            tag: name,
            "what": " ".join((model.__doc__ or "").split("\n\n")[0].split()),
            "keys": described_keys(model, (tag, *common)),
        }
        for name, model in models.items()
    ]


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
