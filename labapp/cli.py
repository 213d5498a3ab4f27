"""The command line: `labapp --help` teaches it.

Commands import what they need when they run, so that help is instant.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

import labapp

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

BenchOption = Annotated[
    Path | None,
    typer.Option("--bench", help="Bench file (TOML). Default: the bundled virtual bench."),
]
SceneOption = Annotated[
    Path | None,
    typer.Option("--scene", help="Scene file (TOML) for simulated devices. Default: bundled."),
]
ImageOption = Annotated[
    Path | None,
    typer.Option("--image", help="Your photograph (JPEG, PNG, TIFF) for the simulated scene."),
]
FaultsOption = Annotated[
    Path | None,
    typer.Option("--faults", help="Fault file (TOML): what simulated devices shall suffer."),
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
JsonOption = Annotated[bool, typer.Option("--json", help="Print figures as JSON.")]
RecordArgument = Annotated[Path, typer.Argument(metavar="RUN.h5", help="Record of a run.")]


def _version(wanted: bool) -> None:
    if wanted:
        print(f"labapp {labapp.__version__}")
        raise typer.Exit


@app.callback()
def labapp_(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print and exit.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error (any command).")
    ] = False,
) -> None:
    """Programmable optics for computational photography.

    A phase-only SLM in front of a camera lens makes the optics programmable. labapp
    computes its patterns, runs acquisitions on a real or simulated bench, and undoes the
    coding. Start with **labapp demo**, which needs no hardware, then open
    **labapp gui**.
    """


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for run.h5, report.png, report.html.")] = Path(
        "first-light"
    ),
    image: ImageOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the run; same seed, same data.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Take a whole coded photograph on the virtual bench, and undo the coding.

    A ring-shaped PSF is computed for the SLM, measured on an artificial star, and used to
    photograph and to reconstruct. Takes a few seconds; writes a record and a report.
    """
    from labapp.demo import run_demo

    run_demo(out, image=image, seed=seed, force=force, as_json=json)


@app.command()
def run(
    plans: Annotated[
        list[Path],
        typer.Argument(
            metavar="PLAN...", help="Plan files (TOML, JSON) or ready plans; several run in turn."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="RUN.h5", help="Record to write; of several plans a folder."),
    ],
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Run acquisition plans on a bench, every frame to disk as it comes.

    In a terminal, **p** pauses after the frame, **r** goes on, Enter answers a prompt, and
    Ctrl-C ends the run safely: SLM neutral, filter parked, camera stopped, the record
    readable and marked CANCELLED. A full disk pauses the run until there is space. Whatever
    ended a run, **labapp resume** takes the frames that it lacks. **labapp plan check** says
    beforehand what a run will take.
    """
    from labapp.bench import BenchFiles
    from labapp.running import Manner, run_files

    files = BenchFiles.default(bench, scene, image, faults)
    run_files(plans, out, files, Manner(force, yes, speed, json))


@app.command()
def resume(
    record: RecordArgument,
    bench: BenchOption = None,
    faults: FaultsOption = None,
    speed: SpeedOption = float("inf"),
    yes: YesOption = False,
    json: JsonOption = False,
) -> None:
    """Take the frames that a record lacks: after a crash, a failure or Ctrl-C.

    Plan, patterns, seed and bench are the record's own, so that it ends as if nothing had
    happened. Frames that don't read back as they were stored are taken again.
    """
    from labapp.running import Manner, resume_file

    resume_file(record, bench, faults, Manner(False, yes, speed, json))


@app.command()
def show(record: RecordArgument, json: JsonOption = False) -> None:
    """Say what a record holds: state, devices, frames, the simulator's decisions, log."""
    from labapp.showing import show_record

    show_record(record, as_json=json)


@app.command()
def report(
    record: RecordArgument,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report. Default: the record's own.")
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Merge, measure, reconstruct, and write report.png and a self-contained report.html."""
    from labapp.report import report_record

    report_record(record, out or record.parent, force=force, as_json=json)


@app.command()
def verify(record: RecordArgument, json: JsonOption = False) -> None:
    """Check that a record is whole: every frame, its checksum, patterns, settings, state.

    The exit code is 0 only if all is well. For a record that isn't, the last line says what
    to do about it.
    """
    from labapp.verifying import verify_record

    raise typer.Exit(0 if verify_record(record, as_json=json) else 1)


@app.command()
def export(
    record: RecordArgument,
    to: Annotated[str, typer.Option(metavar="KIND", help="tiff, png, ome-tiff or npy.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where to; made if need be.")],
    frames: Annotated[
        str | None, typer.Option(metavar="LIST", help="Only these frames: 0-9,12.")
    ] = None,
    target: Annotated[str | None, typer.Option(help="Only frames of this target.")] = None,
    pattern: Annotated[str | None, typer.Option(help="Only frames of this pattern.")] = None,
    force: ForceOption = False,
) -> None:
    """Write frames as files that other programs read, raw and lossless.

    **tiff**, **png**: a 16-bit picture a frame. **ome-tiff**: one file with exposure and time
    of each plane. **npy**: one array, and what is known of it as JSON. With every kind comes
    a table, frames.csv. Digital numbers aren't scaled, so that pictures of a 12-bit camera
    look dark in a viewer that doesn't stretch them. Frames that the record lacks are named,
    and the exit code is 1.
    """
    from labapp.export import Choice, export_record

    export_record(record, to, out, Choice(frames, target, pattern), force=force)


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
    from labapp.asked import Case, read_aberrations, read_stop, read_window
    from optics.camera import Lens

    stop = read_stop(blades, obscuration, rectangle)
    kind: Any = lens
    described = Lens(focal_length, f_number, focus, stop, read_aberrations(zernike or []), kind)
    window = read_window(size, pitch_um * 1e-6, centre)
    return Case(described, distance, wavelength_nm * 1e-9, window)


def _takes_case(**defaults: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Let a command take the options of _case(), and get what they say as its `case`.

    defaults: of the options, where _case() has none.
    """

    def options(function: Callable[..., Any], **changes: Any) -> list[inspect.Parameter]:
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

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        of_case, own = options(_case, **defaults), options(command)

        def run(**given: Any) -> None:
            case = _case(**{one.name: given.pop(one.name) for one in of_case})
            command(case=case, **given)

        # typer reads both.
        run.__signature__ = inspect.Signature([*of_case, *own])  # type: ignore[attr-defined]
        run.__annotations__ = {one.name: one.annotation for one in [*of_case, *own]}
        run.__name__, run.__doc__ = command.__name__, command.__doc__
        return run

    return decorate


@app.command()
@_takes_case(
    focal_length=0.125,
    f_number=5.0,
    focus=2.0,
    distance=2.0,
    wavelength_nm=550.0,
    pitch_um=3.45,
    size=256,
)
def psf(
    case: Any,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help=".npy, .tiff (float) or .png to write.")
    ],
    tol: Annotated[
        float, typer.Option(help="Relative L2 error of sampling and arithmetic to keep.")
    ] = 1e-3,
    points: Annotated[
        bool, typer.Option("--points", help="Light at pixel centres, not on whole pixels.")
    ] = False,
    method: Annotated[
        str | None,
        typer.Option(help="axial, scattered or sampled; none: the cheapest that keeps tol."),
    ] = None,
    memory_mb: Annotated[int, typer.Option(help="Megabytes that may be used.")] = 4000,
    pattern: Annotated[
        Path | None, typer.Option(help="8-bit picture on the SLM before the lens; none: no SLM.")
    ] = None,
    bench: BenchOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Compute a PSF to a tolerance, and say what it cost and how far it can be trusted.

    Without a pattern: a lens with its stop. With one: the panel of the bench file
    before the lens. Values are shares of the light, one a pixel; a picture of five decades
    is written beside the data.
    """
    _one_thread()
    from labapp.predicting import Asked, predict

    asked = Asked(case, tol, points, method, memory_mb * 1_000_000, pattern, bench)
    predict(asked, out, force=force, as_json=json)


accuracy = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(accuracy, name="accuracy")


@accuracy.callback()
def accuracy_() -> None:
    """Show what accuracy costs in time, measured on your machine."""
    _one_thread()


def _one_thread() -> None:
    """The libraries that multiply read this once, when they are loaded: it is early enough."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"


@accuracy.command("psf")
@_takes_case(
    focal_length=0.1,
    f_number=5.6,
    focus=float("inf"),
    distance=2.0,
    wavelength_nm=520.0,
    pitch_um=3.45,
    size=256,
)
def accuracy_psf_(
    case: Any,
    peers: Annotated[
        bool,
        typer.Option("--peers", help="Also prysm, poppy, hcipy and torchoptics, where installed."),
    ] = False,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Rows stored with --json, or 'bundled': name points that became 20 % slower "
            "(relative to a calibration kernel of each run) or 2x less accurate; exit code 1.",
        ),
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the rows as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw error against time (.png, .svg).")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Measure error and time of every method for the PSF of a lens.

    The default case is the one that wave-optics libraries are compared on: 38 waves of
    defocus. Failures are rows too, and no other row beats one on the front in both time
    and error.
    """
    from labapp.accuracy.command import accuracy_psf

    accuracy_psf(case, peers=peers, data=json, plot=plot, compare=compare, force=force)


plan = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
app.add_typer(plan, name="plan")

PlanArgument = Annotated[
    Path, typer.Argument(metavar="PLAN", help="Plan file (TOML, JSON) or name of a ready plan.")
]


@plan.callback()
def plan_() -> None:
    """Look at acquisition plans before they run, and find ready ones."""


@plan.command("check")
def plan_check_(
    plan: PlanArgument,
    bench: BenchOption = None,
    scene: SceneOption = None,
    json: JsonOption = False,
) -> None:
    """Say what a plan takes, and whether a bench can do it; nothing moves.

    Frames, expected duration, prompts of a person, room on the disk, and what is asked for
    beside what the bench has. Patterns are tried. Exit code 1 if the run could not be begun,
    or its pictures not be reconstructed as the plan says.
    """
    from labapp.planning import check_plan

    check_plan(plan, bench, scene, as_json=json)


@plan.command("show")
def plan_show_(
    plan: PlanArgument,
    bench: BenchOption = None,
    scene: SceneOption = None,
    every_row: Annotated[
        bool, typer.Option("--all", help="Print every row, however many there are.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Print a plan's steps in the order in which they are taken, and when each is due.

    Frames that differ in exposure and repeat alone are one row, darks and prompts stand
    where they come. **--json** gives every frame.
    """
    from labapp.planning import show_plan

    show_plan(plan, bench, scene, every_row=every_row, as_json=json)


@plan.command("list")
def plan_list_(json: JsonOption = False) -> None:
    """List the ready plans: what each is for, and what it needs.

    They run as they are on the virtual bench. Each file's comments say what to change for a
    bench of your own: copy it, and pass the copy's path.
    """
    from labapp.ready import list_plans

    list_plans(as_json=json)


@app.command()
def devices(bench: BenchOption = None, scene: SceneOption = None, json: JsonOption = False) -> None:
    """List the bench's devices, the installed drivers, and what is plugged in."""
    from labapp.listing import list_devices

    list_devices(bench, scene, as_json=json)


@app.command()
def figures(
    only: Annotated[
        str | None, typer.Option(metavar="WORD", help="Only figures whose name has this word.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Measure every figure that the README claims, and print it beside its goal."""
    _one_thread()
    from labapp.figures import print_figures

    print_figures(only, as_json=json)


@app.command()
def gui(
    bench: BenchOption = None,
    scene: SceneOption = None,
    image: ImageOption = None,
    faults: FaultsOption = None,
) -> None:
    """Open the bench window; without options, on the bundled virtual bench."""
    from labapp.window.app import main as open_window

    raise typer.Exit(open_window(bench, scene, image, faults))


def main() -> None:
    """Run the command line; errors are one or two lines, and a traceback with --debug."""
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    try:
        app(args=arguments, prog_name="labapp")
    except Exception as error:
        if debug:
            raise
        raise SystemExit(_explain(error)) from None
    except KeyboardInterrupt:
        if debug:
            raise
        raise SystemExit(_explain(KeyboardInterrupt())) from None


def _explain(error: BaseException) -> int:
    """Print an error for a person; the exit code that says what kind it was."""
    from labapp.console import complain
    from optics.progress import Cancelled

    if isinstance(error, BrokenPipeError):
        # Whoever read our output has gone; closing it again would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    if isinstance(error, Cancelled | KeyboardInterrupt):
        complain("cancelled")
        return 130
    complain(_in_words(error))
    return 1


def _in_words(error: Any) -> str:
    from drivers.errors import DeviceError
    from labapp.errors import UserError

    if isinstance(error, UserError | DeviceError | ValueError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}. Check the path and disk."
    return f"unexpected {type(error).__name__}: {error}\nAdd --debug to see where, and report it."
