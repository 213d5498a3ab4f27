"""Options and arguments that several commands take.

Files that aren't there are refused as the command line is read, before anything is loaded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread

if TYPE_CHECKING:
    from labapp.bench.opening import BenchFiles
    from labapp.files.pattern_table import StillPattern
    from labapp.light.simulating.picture_request import PictureRequest
    from labapp.runs.run_commands import ExecutionOptions


def readable_path(path: Path | None) -> Path | None:
    """The path, or None; UserError if it can't be opened."""
    from labapp.files.file_lookup import require_readable

    if path is not None:
        require_readable(path)
    return path


def existing_path(path: Path | None) -> Path | None:
    """The path, or None; UserError if there is no such file."""
    from labapp.files.file_lookup import require_file

    if path is not None:
        require_file(path)
    return path


def find_scene_file(name: Path | None) -> Path | None:
    """The file of a scene, or None; UserError lists the bundled ones."""
    from labapp.files.file_lookup import find_scene

    return None if name is None else find_scene(name)


BenchOption = Annotated[
    Path | None,
    typer.Option(
        callback=readable_path, help="Bench file (TOML). Default: the bundled virtual bench."
    ),
]
SceneOption = Annotated[
    Path | None,
    typer.Option(
        callback=find_scene_file,
        help="Scene for simulated devices: a file (TOML), or the name of a bundled one, as bricks.",
    ),
]
ImageOption = Annotated[
    Path | None,
    typer.Option(
        callback=readable_path, help="Your photograph (JPEG, PNG, TIFF) for the simulated scene."
    ),
]
FaultsOption = Annotated[
    Path | None,
    typer.Option(
        callback=readable_path, help="Fault file (TOML): what simulated devices shall suffer."
    ),
]
KeysArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="Its keys, as in a plan file.")
]
SpeedOption = Annotated[
    float,
    typer.Option(
        help="Seconds of a virtual bench's time in a second; 1 is real time.",
        show_default="as fast as the computer",
    ),
]
YesOption = Annotated[bool, typer.Option("--yes", help="All targets are in place: ask nobody.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print as JSON, for programs.")]
RecordArgument = Annotated[
    Path, typer.Argument(metavar="RUN.h5", callback=existing_path, help="Record of a run.")
]
PeersOption = Annotated[
    bool, typer.Option("--peers", help="Also other libraries, by installed adapters (tests/peers).")
]
CameraOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        callback=readable_path,
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


@dataclass(frozen=True)
class RunOptions:
    """On what bench pictures are taken, and how."""

    bench: BenchOption = None
    scene: SceneOption = None
    faults: FaultsOption = None
    speed: SpeedOption = float("inf")
    yes: YesOption = False
    force: ForceOption = False
    json: JsonOption = False

    def bench_files(self, image: Path | None = None) -> BenchFiles:
        from labapp.bench.opening import BenchFiles

        return BenchFiles.with_defaults(self.bench, self.scene, image, self.faults)

    @property
    def run_mode(self) -> ExecutionOptions:
        from labapp.runs.run_commands import ExecutionOptions

        return ExecutionOptions(self.force, self.yes, self.speed, self.json)


@dataclass(frozen=True)
class StarOptions:
    """The artificial star that panel and lens are measured with."""

    star: Annotated[str, typer.Option(help="The target with the star.")] = "star"
    dark: Annotated[str, typer.Option(help="The target without light; '' for none.")] = "dark"
    star_um: Annotated[
        float | None, typer.Option(help="Diameter of the pinhole.", show_default="the scene's")
    ] = None
    star_m: Annotated[
        float | None,
        typer.Option(help="Distance of the pinhole.", show_default="the scene's, or in focus"),
    ] = None


@dataclass(frozen=True)
class DesignOptions:
    """What a pattern is made for, and where it goes."""

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=".png for any SLM software, or .h5 with everything that it was made from.",
        ),
    ] = None
    wavelength_nm: Annotated[
        float, typer.Option(help="For which it is made, and its PSF predicted.")
    ] = 550.0
    frames: Annotated[
        int, typer.Option(min=1, help="Of a video: numbered .png files, or one .h5.")
    ] = 1
    seed: Annotated[int, typer.Option(min=0, help="All chance comes from it.")] = 1
    size: Annotated[
        int | None, typer.Option(min=16, max=2048, help="Sensor pixels across the predicted PSF.")
    ] = None
    bench: BenchOption = None
    force: ForceOption = False
    json: JsonOption = False

    def design_and_write(self, spec: StillPattern) -> None:
        """Compute a pattern, predict its PSF, and write both; UserError names what can't be."""
        from labapp.files.output_paths import pattern_output_paths
        from labapp.patterns.designing.design_request import DesignRequest

        if self.out is None:
            raise UserError("there is no --out. Name a .png or .h5 file to write.")
        wavelength = getattr(spec, "wavelength_nm", self.wavelength_nm) * 1e-9
        asked = DesignRequest(spec, wavelength, self.frames, self.seed, self.bench, self.size)
        files, drawn = pattern_output_paths(self.out, self.frames, force=self.force)
        use_one_thread()
        from labapp.patterns.designing.command import write_pattern

        write_pattern(asked, files, drawn, as_json=self.json)


@dataclass(frozen=True)
class EffectOptions:
    """What the virtual bench may leave out of a picture."""

    tol: Annotated[
        float | None, typer.Option(help="Error to leave effects out for. Default: the scene's.")
    ] = None
    set: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT=LEVEL", help="Force an effect: on, off or a level."),
    ] = None


@dataclass(frozen=True)
class PictureOptions:
    """A picture that the virtual bench takes of a scene."""

    scene: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCENE.toml",
            callback=find_scene_file,
            help="Scene file. Default: the bundled photograph.",
        ),
    ] = None
    target: Annotated[str | None, typer.Option(help="Target of the scene. Default: its first.")] = (
        None
    )
    pattern: Annotated[
        Path | None,
        typer.Option(callback=readable_path, help="8-bit picture on the panel. Default: neutral."),
    ] = None
    wavelength_nm: Annotated[float | None, typer.Option(help="Of the filter, in nanometres.")] = (
        None
    )
    exposure_ms: Annotated[
        float | None,
        typer.Option(help="In milliseconds. Default: fills the brightest pixel to half."),
    ] = None

    def picture_request(
        self,
        bench: Path | None,
        effect_options: EffectOptions | None = None,
        *,
        everything: bool = False,
    ) -> PictureRequest:
        """The picture on a bench; with all that is left out decided by the scene, if not here."""
        from labapp.light.simulating.picture_request import PictureRequest, parse_forced_effects

        effect_options = effect_options or EffectOptions()
        return PictureRequest(
            self.scene,
            bench,
            self.target,
            self.pattern,
            None if self.wavelength_nm is None else self.wavelength_nm * 1e-9,
            None if self.exposure_ms is None else self.exposure_ms * 1e-3,
            effect_options.tol,
            parse_forced_effects(effect_options.set or []),
            everything,
        )


@dataclass(frozen=True)
class RowsOutputOptions:
    """Where measured rows go."""

    json: JsonOption = False
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the rows against time (.png, .svg).")
    ] = None
    force: ForceOption = False

    def require_writable(self) -> None:
        """UserError if the plot can't be written where it is asked for."""
        from labapp.files.writing import require_all_writable

        require_all_writable((self.plot,), force=self.force)
