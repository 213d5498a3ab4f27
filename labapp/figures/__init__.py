"""Every figure that the README claims, measured by one command beside its goal."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from labapp.console import out, print_json, say, table
from labapp.errors import UserError


@dataclass(frozen=True)
class Figure:
    """One figure: what, the goal in words, what was measured, and whether it is met.

    met is None where it could not be measured; `measured` then says why.
    """

    name: str
    goal: str
    measured: str
    met: bool | None


Measurement = Callable[[Path], Iterable[Figure]]


def measurements() -> dict[str, Measurement]:
    """The measurements by name; each may yield several figures that it finds in one go."""
    from labapp.figures import (
        blind,
        budget,
        calibration,
        camera_faults,
        chain_cost,
        chains,
        closed_forms,
        deconvolution,
        demosaicing,
        depth,
        durability,
        edge_mtf,
        effects,
        first_light,
        free_space,
        free_space_peers,
        free_space_problems,
        full_disk,
        fuzz,
        gige,
        live,
        peers,
        problems,
        promptness,
        psf,
        restoration_priors,
        retrieval,
        sensor_emva,
        separable,
        startup,
        troubles,
        unplug,
        wire_faults,
        work_saved,
        wrong_exposures,
    )

    return {
        "help": startup.help_time,
        "window": startup.window_time,
        "import": startup.import_time,
        "demo": first_light.demo_figures,
        "quadrature": first_light.prediction_figure,
        "psf": psf.psf_cost,
        "pixelated": psf.pixelated_cost,
        "float32": psf.single_precision,
        "peers": peers.against_peers,
        "closed-forms": closed_forms.closed_forms,
        "tolerance": problems.tolerance_figure,
        "regret": problems.regret_figure,
        "free-space": free_space.closed_forms,
        "propagation": free_space_problems.tolerance_figure,
        "propagation-regret": free_space_problems.regret_figure,
        "propagation-peers": free_space_peers.against_peers,
        "chains": chains.chain_tolerance_figure,
        "chain-regret": chains.chain_regret_figure,
        "thesis-camera": chain_cost.thesis_camera_cost,
        "iteration": retrieval.iteration_cost,
        "frame": retrieval.single_frames,
        "video": retrieval.several_frames,
        "crystal": retrieval.slow_crystal,
        "published": retrieval.published_patterns,
        "calibration": calibration.calibration_figures,
        "seed": durability.same_seed,
        "kill": durability.after_kills,
        "disk": full_disk.full_disk_figure,
        "faults": troubles.fault_figure,
        "wire": wire_faults.serial_fault_figure,
        "usb": wire_faults.usb_fault_figure,
        "fuzz": fuzz.fuzz_figure,
        "unplug": unplug.unplug_figure,
        "cancel": promptness.cancel_figure,
        "overhead": promptness.overhead_figure,
        "sustained": promptness.sustained_figure,
        "effects": effects.effects_figures,
        "work": work_saved.work_figures,
        "emva": sensor_emva.emva_figures,
        "edge": edge_mtf.edge_figure,
        "live": live.live_figures,
        "depth": depth.depth_figure,
        "deconvolution": deconvolution.blur_figures,
        "scikit-image": deconvolution.against_scikit_image,
        "weights": deconvolution.weights_figure,
        "learned": deconvolution.learned_figure,
        "budget": budget.budget_figure,
        "separable": separable.separable_figure,
        "layers": separable.depths_figure,
        "restoration-priors": restoration_priors.restoration_figures,
        "demosaicing": demosaicing.demosaicing_figures,
        "blind": blind.blind_figures,
        "wrong-exposures": wrong_exposures.wrong_exposures_figure,
        "gige": gige.gige_figure,
        "camera-faults": camera_faults.camera_fault_figure,
    }


def print_figures(only: str | None, *, as_json: bool) -> None:
    """Measure and print; ends with exit code 1 if a figure misses its goal.

    UserError if no measurement's name has the word `only`.
    """
    chosen = {name: m for name, m in measurements().items() if only is None or only in name}
    if not chosen:
        raise UserError(f"--only {only}: no such figure. Choose {', '.join(measurements())}.")
    found: list[Figure] = []
    for name, measure in chosen.items():
        say(f"measuring: {name}")
        with TemporaryDirectory(prefix="labapp-") as folder:
            found += measure(Path(folder))
    if as_json:
        print_json({"machine": machine(), "figures": [asdict(figure) for figure in found]})
    else:
        marks = {True: "[green]met[/green]", False: "[red]missed[/red]", None: "not measured"}
        rows = [[f.name, f.measured, f.goal, marks[f.met]] for f in found]
        table("Figures", ["figure", "measured", "goal", ""], rows)
        out.print(machine(), style="dim")
    if any(figure.met is False for figure in found):
        raise SystemExit(1)


def machine() -> str:
    """The machine in a line, for the caption of figures."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"
