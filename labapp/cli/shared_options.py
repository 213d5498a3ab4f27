"""Options and arguments that several commands share.

Missing files are refused while the command line is parsed, before anything heavy is imported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from labapp.cli.option_groups import get_option_group
from labapp.common.errors import UserError
from labapp.common.threads import use_one_thread

if TYPE_CHECKING:
    from labapp.bench.opening import BenchFiles
    from labapp.files.pattern_table import StillPattern
    from labapp.prediction.simulating.picture_request import PictureRequest
    from labapp.runs.run_commands import ExecutionOptions


def readable_path(path: Path | None) -> Path | None:
    """Return a path, or None; raise UserError if it can't be opened."""
    from labapp.files.guarded_reading import require_regular

    if path is not None:
        require_regular(path)
    return path


def light_in_nanometres(value: Any, param: typer.CallbackParam) -> Any:
    """Return one wavelength, several or None; raise UserError if they can't be nm."""
    from labapp.files.wavelengths import require_nanometres

    for one in value if isinstance(value, list | tuple) else [value]:
        if one is not None:
            require_nanometres(param.opts[0], one)
    return value


def existing_path(path: Path | None) -> Path | None:
    """Return a path, or None; raise UserError if there is no such file."""
    from labapp.files.file_lookup import require_file

    if path is not None:
        require_file(path)
    return path


def find_scene_file(name: Path | None) -> Path | None:
    """Return a scene file by path or name, or None; UserError lists the bundled scenes."""
    from labapp.files.file_lookup import find_scene

    return None if name is None else find_scene(name)


def find_encoding(word: str | None) -> str | None:
    """Return the name of an encoding, or None; UserError lists them."""
    from labapp.files.picture.encoding import parse_encoding

    return None if word is None else parse_encoding(word).name


def light_option(words: str, **more: Any) -> Any:
    """Return an option of wavelengths in nm, which are checked while they are parsed."""
    return typer.Option(callback=light_in_nanometres, help=words, **more)


def file_option(words: str, **more: Any) -> Any:
    """Return an option of a file, which must be readable."""
    return typer.Option(callback=readable_path, help=words, **more)


EncodingOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        callback=find_encoding,
        help="How the picture's numbers stand for light: linear, srgb, bt709, or gamma 2.2 (or "
        "another number).",
        show_default="what the file says; else srgb in 8-bit pictures, and linear",
    ),
]
BenchOption = Annotated[
    Path | None, file_option("Bench file (TOML). Default: the bundled virtual bench.")
]
SceneOption = Annotated[
    Path | None,
    typer.Option(
        callback=find_scene_file,
        help="Scene for simulated devices: a file (TOML), or a bundled scene, such as bricks.",
    ),
]
ImageOption = Annotated[
    Path | None, file_option("Your photograph (JPEG, PNG, TIFF) for the simulated scene.")
]
FaultsOption = Annotated[
    Path | None, file_option("Fault file (TOML) with faults of simulated devices.")
]
KeysArgument = Annotated[
    list[str] | None,
    typer.Argument(metavar="[KEY=VALUE]...", help="Keys, written as in a plan file."),
]
SpeedOption = Annotated[
    float,
    typer.Option(
        help="Speed of a virtual bench's clock; 1 is real time, 2 twice as fast.",
        show_default="as fast as the computer",
    ),
]
MemoryOption = Annotated[
    float | None,
    typer.Option(
        metavar="GB",
        help="Memory in GB for what simulated pictures share with later ones.",
        show_default="0.6 and 75 bytes a pixel; a quarter of the machine's at most",
    ),
]
WaitLimitOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        min=0,
        help="Longest wait for a full disk, a failed device or an answer; then the run ends with "
        "exit code 75, and can be resumed.",
        show_default="without end at a terminal, else 3600",
    ),
]
YesOption = Annotated[
    bool, typer.Option("--yes", help="Don't prompt: all targets are in place already.")
]
ReadoutOption = Annotated[
    int | None,
    typer.Option(
        metavar="NUMBER",
        help="Frames of a record that were read in this way, from 0, where gain, region or binning "
        "change.",
        show_default="the only one",
    ),
]

ForceOption = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
RecordArgument = Annotated[
    Path, typer.Argument(metavar="RUN.h5", callback=existing_path, help="Record of a run.")
]
PeersOption = Annotated[
    bool,
    typer.Option(
        "--peers", help="Measure other libraries, too, by installed adapters (tests/peers)."
    ),
]
CameraOption = Annotated[
    Path | None,
    file_option(
        "Camera file or bench file (TOML), like labapp/data/thesis-camera.toml.", metavar="FILE"
    ),
]
WavelengthOption = Annotated[float, light_option("Wavelength in nanometres.")]
NeutralPatternOption = Annotated[
    Path | None, file_option("Pattern on the panel, an 8-bit picture. Default: neutral.")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
PixelNoiseOption = Annotated[
    float, typer.Option(help="Standard deviation of a pixel's noise, where white is 1.")
]
SphereOption = Annotated[
    bool,
    typer.Option("--sphere", help="Use a spherical wave of the object instead of a parabola."),
]
FieldOption = Annotated[
    str,
    typer.Option(
        metavar="Y,X",
        help="Position of the point's image on the sensor, in millimetres from the axis.",
    ),
]


def memory_bytes(gigabytes: float | None) -> int | None:
    """Convert gigabytes to bytes; None stays None.

    Raises UserError for a number that isn't finite and positive.
    """
    if gigabytes is None:
        return None
    if not 0 < gigabytes < math.inf:
        raise UserError(f"--memory {gigabytes:g}: give a positive number of GB, as 2.")
    return round(gigabytes * 1e9)


@dataclass(frozen=True)
class RunOptions:
    """The bench on which frames are acquired, and how it runs."""

    bench: BenchOption = None
    scene: SceneOption = None
    faults: FaultsOption = None
    speed: SpeedOption = float("inf")
    memory: MemoryOption = None
    yes: YesOption = False
    wait_limit: WaitLimitOption = None
    force: ForceOption = False
    json: JsonOption = False

    def bench_files(self, image: Path | None = None) -> BenchFiles:
        """Return the bench's files that were named, the bundled ones by default."""
        from labapp.bench.opening import BenchFiles

        memory = memory_bytes(self.memory)
        return BenchFiles.with_defaults(self.bench, self.scene, image, self.faults, memory)

    @property
    def run_mode(self) -> ExecutionOptions:
        """Return overwriting, prompts, speed, output and the limit of waits."""
        from labapp.runs.run_commands import ExecutionOptions

        return ExecutionOptions(self.force, self.yes, self.speed, self.json, self.wait_limit)


@dataclass(frozen=True)
class StarOptions:
    """Describe the artificial star with which panel and lens are measured."""

    star: Annotated[str, typer.Option(help="Name of the target with the star.")] = "star"
    dark: Annotated[
        str, typer.Option(help="Name of the target without light; '' for no dark frames.")
    ] = "dark"
    star_um: Annotated[
        float | None,
        typer.Option(help="Diameter of the star, in micrometres.", show_default="the scene's"),
    ] = None
    star_m: Annotated[
        float | None,
        typer.Option(
            help="Distance of the star, in metres.", show_default="the scene's, or in focus"
        ),
    ] = None


@dataclass(frozen=True)
class DesignOptions:
    """Output, wavelength, length and seed of a pattern that is computed."""

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File to write: .png for any SLM software, or .h5 with all inputs of the design.",
        ),
    ] = None
    wavelength_nm: Annotated[
        float, light_option("Wavelength of pattern and predicted PSF, in nanometres.")
    ] = 550.0
    frames: Annotated[
        int, typer.Option(min=1, help="Frames of a video, in numbered .png files or one .h5.")
    ] = 1
    seed: SeedOption = 1
    size: Annotated[
        int | None, typer.Option(min=16, max=2048, help="Sensor pixels across the predicted PSF.")
    ] = None
    bench: BenchOption = None
    force: ForceOption = False
    json: JsonOption = False

    def design_and_write(self, spec: StillPattern) -> None:
        """Compute a pattern, predict its PSF, and write both.

        Raises UserError for options that are wrong, or a pattern that the panel can't show.
        """
        from labapp.files.output_paths import pattern_output_paths
        from labapp.patterns.designing.kinds import DesignRequest

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
    """Decide which effects the virtual bench leaves out of a picture."""

    tol: Annotated[
        float | None,
        typer.Option(help="Relative error that omitted effects may cause. Default: the scene's."),
    ] = None
    decide_by: Annotated[
        Literal["estimate", "bound"] | None,
        typer.Option(
            help="What decides about effects: audited estimates, or bounds that prove the error. "
            "Default: the scene's."
        ),
    ] = None
    set: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT=LEVEL", help="Force an effect: on, off or a level."),
    ] = None


@dataclass(frozen=True)
class PictureOptions:
    """Describe a picture that the virtual bench takes of a scene."""

    scene: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCENE.toml",
            callback=find_scene_file,
            help="Scene file. Default: the bundled one, with a star, a photograph and prints.",
        ),
    ] = None
    target: Annotated[
        str | None, typer.Option(help="Target of the scene. Default: its first that isn't dark.")
    ] = None
    pattern: NeutralPatternOption = None
    wavelength_nm: Annotated[
        float | None, light_option("Wavelength of the filter, in nanometres.")
    ] = None
    exposure_ms: Annotated[
        float | None,
        typer.Option(
            help="Exposure time in milliseconds. Default: fills the brightest pixel to half."
        ),
    ] = None

    def picture_request(
        self,
        bench: Path | None,
        effect_options: EffectOptions | None = None,
        *,
        everything: bool = False,
    ) -> PictureRequest:
        """Return the request for the picture on a bench.

        `effect_options` decide which effects are left out; if they are None, the scene decides.
        `everything` requests all effects at their finest.
        """
        from labapp.prediction.simulating.picture_request import (
            PictureRequest,
            parse_forced_effects,
        )

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
            effect_options.decide_by,
        )


@dataclass(frozen=True)
class RowsOutputOptions:
    """Output of measured rows: JSON, and their diagram."""

    json: JsonOption = False
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Diagram of the rows against time (.png, .svg)."),
    ] = None
    force: ForceOption = False


def require_writable_rows(context: typer.Context) -> RowsOutputOptions:
    """Return the output of measured rows; raise UserError if --plot can't be written."""
    from labapp.files.writing import require_all_writable

    rows = get_option_group(context, RowsOutputOptions)
    require_all_writable((rows.plot,), force=rows.force)
    return rows


def require_one_length(steps: int | None, minutes: float | None) -> None:
    """Raise UserError if both a number of steps and of minutes are given."""
    if steps is not None and minutes is not None:
        raise UserError("--minutes and --steps: give one of them.")


def require_options_of_kind(kind: str, options: dict[tuple[str, ...], dict[str, Any]]) -> None:
    """Raise UserError for options that mean nothing to the kind of work that is asked for.

    kind: option that chooses the kind, as "--camera"; "" for the usual one.
    options: values of options by the kinds to which they mean something; None for one that isn't
        given.
    """
    for kinds, values in options.items():
        given = next((name for name, value in values.items() if value is not None), None)
        if given is None or kind in kinds:
            continue
        if kind:
            raise UserError(f"{given}: means nothing with {kind}. Leave one of the two out.")
        named = " or ".join(one for one in kinds if one)
        raise UserError(
            f"{given}: means something with {named} only. Add {kinds[-1]}, or leave it out."
        )
