"""The measurements by name."""

from __future__ import annotations

import importlib

from figures import Measurement

MEASUREMENTS = {
    "help": "startup.help_time",
    "window": "startup.window_time",
    "import": "startup.import_time",
    "demo": "first_light.demo_figures",
    "quadrature": "first_light.prediction_figure",
    "psf": "psf.psf_cost",
    "pixelated": "psf.pixelated_cost",
    "float32": "psf.single_precision",
    "peers": "peers.against_peers",
    "closed-forms": "closed_forms.closed_forms",
    "tolerance": "problems.tolerance_figure",
    "regret": "problems.regret_figure",
    "free-space": "free_space.closed_forms",
    "propagation": "free_space_problems.tolerance_figure",
    "propagation-regret": "free_space_problems.regret_figure",
    "propagation-peers": "free_space_peers.against_peers",
    "chains": "chains.chain_tolerance_figure",
    "chain-regret": "chains.chain_regret_figure",
    "thesis-camera": "chain_cost.thesis_camera_cost",
    "iteration": "retrieval.iteration_cost",
    "frame": "retrieval.single_frames",
    "video": "retrieval.several_frames",
    "crystal": "retrieval.slow_crystal",
    "published": "retrieval.published_patterns",
    "calibration": "calibration.calibration_figures",
    "seed": "durability.same_seed",
    "kill": "durability.after_kills",
    "disk": "full_disk.full_disk_figure",
    "faults": "troubles.fault_figure",
    "wire": "wire_faults.serial_fault_figure",
    "usb": "wire_faults.usb_fault_figure",
    "fuzz": "fuzz.fuzz_figure",
    "unplug": "unplug.unplug_figure",
    "cancel": "promptness.cancel_figure",
    "overhead": "promptness.overhead_figure",
    "sustained": "promptness.sustained_figure",
    "effects": "effects.effects_figures",
    "work": "work_saved.work_figures",
    "emva": "sensor_emva.emva_figures",
    "edge": "edge_mtf.edge_figure",
    "live": "live.live_figures",
    "depth": "depth.depth_figure",
    "deconvolution": "deconvolution.blur_figures",
    "scikit-image": "deconvolution.against_scikit_image",
    "weights": "deconvolution.weights_figure",
    "learned": "deconvolution.learned_figure",
    "budget": "budget.budget_figure",
    "separable": "separable.separable_figure",
    "layers": "separable.depths_figure",
    "restoration-priors": "restoration_priors.restoration_figures",
    "demosaicing": "demosaicing.demosaicing_figures",
    "blind": "blind.blind_figures",
    "wrong-exposures": "wrong_exposures.wrong_exposures_figure",
    "screen": "screen.screen_figure",
    "presentations": "presentations.presentations_figures",
    "gige": "gige.gige_figure",
    "camera-faults": "camera_faults.camera_fault_figure",
}
"""Name to module and function: a module is imported when it's measured, as most load torch."""


def measurement(name: str) -> Measurement:
    module, _, function = MEASUREMENTS[name].partition(".")
    found: Measurement = getattr(importlib.import_module(f"figures.{module}"), function)
    return found
