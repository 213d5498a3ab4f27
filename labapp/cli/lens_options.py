"""Options that describe a lens, its object, and a window on the image."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import typer

from labapp.cli.option_groups import get_option_group
from labapp.cli.shared_options import CameraOption, WavelengthOption


@dataclass(frozen=True)
class CameraOptions:
    """The camera file that may describe a lens."""

    camera: CameraOption = None


@dataclass(frozen=True)
class LensOptions:
    """Describe a lens, its object, and a window on the image."""

    focal_length: Annotated[float, typer.Option(help="Focal length of the lens, in metres.")] = (
        0.125
    )
    f_number: Annotated[float, typer.Option(help="Focal length over the diameter of the stop.")] = (
        5.0
    )
    focus: Annotated[
        float, typer.Option(help="Distance of the plane in focus, in metres; inf is allowed.")
    ] = 2.0
    distance: Annotated[
        float, typer.Option(help="Distance of the object, in metres; inf is allowed.")
    ] = 2.0
    wavelength_nm: WavelengthOption = 550.0
    pitch_um: Annotated[
        float, typer.Option(help="Pitch of the sensor's pixels, in micrometres.")
    ] = 3.45
    size: Annotated[int, typer.Option(help="Side of the square window, in pixels.")] = 256
    centre: Annotated[
        str,
        typer.Option(metavar="Y,X", help="Centre of the window, in micrometres from the axis."),
    ] = "0,0"
    blades: Annotated[
        int, typer.Option(help="Number of straight blades of the stop; 0 for a round stop.")
    ] = 0
    rectangle: Annotated[
        str | None,
        typer.Option(metavar="HxW", help="Rectangular stop, in stop diameters, such as 0.5x0.7."),
    ] = None
    obscuration: Annotated[
        float, typer.Option(help="Radius of a central disc that covers the stop, in stop radii.")
    ] = 0.0
    zernike: Annotated[
        list[str] | None,
        typer.Option(
            metavar="N,M,NM",
            help="Aberration: orders n and m of its Zernike polynomial, and its root mean square "
            "in nanometres; repeat the option for more.",
        ),
    ] = None
    lens: Annotated[
        str,
        typer.Option(
            help="Kind of lens: thin (quadratic phase) or stigmatic (corrected for its plane in "
            "focus, sine condition)."
        ),
    ] = "thin"

    def build_case(self) -> Any:
        """Build lens, object and window; UserError names a wrong option."""
        from labapp.prediction.lens_options import (
            LensCase,
            read_aberrations,
            read_stop,
            read_window,
        )

        aberrations = read_aberrations(self.zernike or [])
        stop = read_stop(self.blades, self.obscuration, self.rectangle)
        window = read_window(self.size, self.pitch_um * 1e-6, self.centre)
        from optics.camera import Lens

        kind: Any = self.lens
        lens = Lens(self.focal_length, self.f_number, self.focus, stop, aberrations, kind)
        return LensCase(lens, self.distance, self.wavelength_nm * 1e-9, window)


def build_lens_case(context: typer.Context) -> Any:
    """Build lens, object and window from options and the camera file, if there is one.

    Options that the user gives explicitly override the file.
    """
    options = get_option_group(context, LensOptions)
    camera = get_option_group(context, CameraOptions).camera
    if camera is None:
        return options.build_case()
    from labapp.files.bench_file import read_camera_file
    from labapp.prediction.lens_options import lens_option_defaults, with_panel_in_front

    sources = {one.name: context.get_parameter_source(one.name) for one in fields(LensOptions)}
    chosen = {name for name, source in sources.items() if source and source.name == "COMMANDLINE"}
    file = read_camera_file(camera)
    described = file.build_camera()
    words: dict[str, Any] = lens_option_defaults(described)
    said = {name: word for name, word in words.items() if name not in chosen}
    case = with_panel_in_front(replace(options, **said).build_case(), described, chosen)
    return replace(case, interference=file.interference)
