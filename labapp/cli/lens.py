"""A lens and a window on its image, as options of a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from labapp.cli.options import readable

FocalLength = Annotated[float, typer.Option(help="Of the lens, in metres.")]
FNumber = Annotated[float, typer.Option(help="Focal length over the stop's diameter.")]
Focus = Annotated[float, typer.Option(help="Plane in focus, in metres; inf is allowed.")]
Distance = Annotated[float, typer.Option(help="Of the object, in metres; inf is allowed.")]
Wavelength = Annotated[float, typer.Option(help="Wavelength in nanometres.")]
Pitch = Annotated[float, typer.Option(help="Of the sensor's pixels, in micrometres.")]
Size = Annotated[int, typer.Option(help="Side of the square window, in pixels.")]
Centre = Annotated[
    str, typer.Option(metavar="Y,X", help="Of the window, in micrometres from the axis.")
]
Blades = Annotated[int, typer.Option(help="Straight blades of the stop; 0: a round one.")]
Rectangle = Annotated[
    str | None, typer.Option(metavar="HxW", help="A rectangular stop, in stop diameters: 0.5x0.7.")
]
Obscuration = Annotated[
    float, typer.Option(help="Radius of a central disc that hides the stop, in stop radii.")
]
Zernike = Annotated[
    list[str] | None,
    typer.Option(
        metavar="N,M,NM",
        help="An aberration by its Zernike polynomial and its root mean square in nanometres; "
        "repeat for more.",
    ),
]
LensKind = Annotated[
    str,
    typer.Option(
        "--lens",
        help="thin: quadratic phase. stigmatic: corrected for its plane in focus, sine condition.",
    ),
]

CameraOption = Annotated[
    Path | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        callback=readable,
        help="Camera file or bench file (TOML), like labapp/data/thesis-camera.toml.",
    ),
]
FieldOption = Annotated[
    str,
    typer.Option(
        metavar="Y,X",
        help="Where the point's image lies on the sensor, in millimetres from the axis.",
    ),
]


def _case(
    focal_length: FocalLength,
    f_number: FNumber,
    focus: Focus,
    distance: Distance,
    wavelength_nm: Wavelength,
    pitch_um: Pitch,
    size: Size,
    centre: Centre = "0,0",
    blades: Blades = 0,
    rectangle: Rectangle = None,
    obscuration: Obscuration = 0.0,
    zernike: Zernike = None,
    lens: LensKind = "thin",
) -> Any:
    """The options of a lens and a window, read."""
    from labapp.light.asked import Case, read_aberrations, read_stop, read_window

    aberrations, stop = read_aberrations(zernike or []), read_stop(blades, obscuration, rectangle)
    window = read_window(size, pitch_um * 1e-6, centre)
    from optics.camera import Lens

    kind: Any = lens
    described = Lens(focal_length, f_number, focus, stop, aberrations, kind)
    return Case(described, distance, wavelength_nm * 1e-9, window)


def takes_case(
    *, of_file: bool = False, **defaults: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Let a command take the options of _case(), and get a function `case` that reads them.

    It loads what describes a lens: a command has read its own words before it calls it. of_file:
    also take --camera, whose file says what no option does. defaults: of the options,
    where _case() has none.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        of_case, own = _options(_case, **defaults), _options(command)
        camera = _options(_camera) if of_file else []

        def run(**given: Any) -> None:
            values = {one.name: given.pop(one.name) for one in of_case}
            case = partial(_case, **values)
            if of_file:
                chosen = _chosen(given.pop("context"))
                case = partial(_case_of, given.pop("camera"), values, chosen)
            command(case=case, **given)

        # typer reads both.
        parameters = [*camera, *of_case, *own]
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in parameters}
        run.__name__, run.__doc__ = command.__name__, command.__doc__
        return run

    return decorate


def _camera(context: typer.Context, camera: CameraOption = None) -> None:
    """What a command takes besides, if a file may describe the lens."""


def _chosen(context: typer.Context) -> set[str]:
    """The names of the options that the command line really gives."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return {name for name, source in sources.items() if source and source.name == "COMMANDLINE"}


def _case_of(camera: Path | None, values: dict[str, Any], chosen: set[str]) -> Any:
    """The case of the options, behind the panel of a camera's file if there is one; options
    that are given count more than the file."""
    if camera is None:
        return _case(**values)
    from labapp.files.bench_file import read_camera_file
    from labapp.light.asked import behind_panel, words_of

    file = read_camera_file(camera)
    described = file.build_camera()
    said = {name: word for name, word in words_of(described).items() if name not in chosen}
    case = behind_panel(_case(**values | said), described, chosen)
    return replace(case, interference=file.interference)


def _options(function: Callable[..., Any], **changes: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(function, include_extras=True)
    found = inspect.signature(function).parameters.values()
    return [
        one.replace(
            annotation=hints[one.name],
            default=changes.get(one.name, one.default),
            kind=inspect.Parameter.KEYWORD_ONLY,
        )
        for one in found
        if one.name != "case"
    ]
