"""Commands that say and show what the virtual bench makes of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from labapp.cli.app import app
from labapp.cli.optics import accuracy
from labapp.cli.options import BenchOption, ForceOption, JsonOption, readable, scene_of

if TYPE_CHECKING:
    from labapp.light.simulating.asked import AskedPicture

SceneArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="SCENE.toml",
        callback=scene_of,
        help="Scene file. Default: the bundled photograph.",
    ),
]
TargetOption = Annotated[str | None, typer.Option(help="Target of the scene. Default: its first.")]
PatternOption = Annotated[
    Path | None,
    typer.Option(callback=readable, help="8-bit picture on the panel. Default: neutral."),
]
WavelengthOption = Annotated[
    float | None, typer.Option("--wavelength-nm", help="Of the filter, in nanometres.")
]
ExposureOption = Annotated[
    float | None,
    typer.Option(
        "--exposure-ms", help="In milliseconds. Default: fills the brightest pixel to half."
    ),
]
ToleranceOption = Annotated[
    float | None, typer.Option(help="Error to leave effects out for. Default: the scene's.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="EFFECT=LEVEL", help="Force an effect: on, off or a level."),
]


def _asked(
    scene: Path | None,
    bench: Path | None,
    target: str | None,
    pattern: Path | None,
    wavelength_nm: float | None,
    exposure_ms: float | None,
    tol: float | None,
    forced: list[str] | None,
    everything: bool = False,
) -> AskedPicture:
    from labapp.light.simulating.asked import AskedPicture, read_forced

    return AskedPicture(
        scene,
        bench,
        target,
        pattern,
        None if wavelength_nm is None else wavelength_nm * 1e-9,
        None if exposure_ms is None else exposure_ms * 1e-3,
        tol,
        read_forced(forced or []),
        everything,
    )


@app.command()
def explain(
    scene: SceneArgument = None,
    bench: BenchOption = None,
    target: TargetOption = None,
    pattern: PatternOption = None,
    wavelength_nm: WavelengthOption = None,
    exposure_ms: ExposureOption = None,
    tol: ToleranceOption = None,
    set_: SetOption = None,
    audit: Annotated[
        bool, typer.Option(help="Put back what is left out, and check it against its bound.")
    ] = False,
    pairs: Annotated[int, typer.Option(help="Pairs of effects that --audit puts back.")] = 10,
    json: JsonOption = False,
) -> None:
    """Say which effects a picture of a scene calls for, how far, and why.

    Each effect is named with the level at which it is computed, the most that it may change
    beyond that, and the physics in a sentence. The sum of all bounds stays within the
    tolerance. The exit code is 1 if **--audit** finds a bound broken.
    """
    from labapp.light.simulating.explaining import explain as explained

    asked = _asked(scene, bench, target, pattern, wavelength_nm, exposure_ms, tol, set_)
    if not explained(asked, audited=audit, pairs=pairs, as_json=json):
        raise typer.Exit(1)


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(metavar="FILE", help="To write: .h5, .tiff or .png.")],
    scene: SceneArgument = None,
    bench: BenchOption = None,
    target: TargetOption = None,
    pattern: PatternOption = None,
    wavelength_nm: WavelengthOption = None,
    exposure_ms: ExposureOption = None,
    tol: ToleranceOption = None,
    set_: SetOption = None,
    frames: Annotated[int, typer.Option(help="Number of frames; noise differs in each.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    everything: Annotated[
        bool, typer.Option(help="All effects at their finest, whatever the tolerance.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Take pictures of a scene with the virtual bench, without a run.

    Files hold raw digital numbers, not stretched: pictures of a 12-bit camera look dark in a
    viewer that takes them for 16 bits. **.h5** holds the mean picture and the variance as well,
    and what was decided.
    """
    from labapp.files.places import place_of_frames

    place, kind = place_of_frames(out, frames, force=force)
    from labapp.light.simulating.picturing import simulate as simulated

    asked = _asked(scene, bench, target, pattern, wavelength_nm, exposure_ms, tol, set_, everything)
    simulated(asked, place, kind, frames=frames, seed=seed)


@accuracy.command("simulate")
def accuracy_simulate_(
    scene: SceneArgument = None,
    bench: Annotated[
        Path | None,
        typer.Option(
            callback=readable,
            help="Bench file (TOML).",
            show_default="the bundled one, with few pixels",
        ),
    ] = None,
    target: TargetOption = None,
    pattern: PatternOption = None,
    wavelength_nm: WavelengthOption = None,
    exposure_ms: ExposureOption = None,
    json: JsonOption = False,
) -> None:
    """Measure what a tolerance costs a simulated picture, and whether it is kept.

    One picture is taken by the plan for each tolerance, and with every effect at its finest.
    Errors are those of the mean picture, of the map of variances, and of that of standard
    deviations. Everything on takes minutes on a bench of full size: hence the few pixels.
    """
    from labapp.accuracy.simulate import accuracy_simulate

    asked = _asked(scene, bench, target, pattern, wavelength_nm, exposure_ms, None, None)
    accuracy_simulate(asked, as_json=json)
