"""All rows, by subject, in the order in which light meets them."""

from __future__ import annotations

from hard_cases import (
    chains,
    depth_designs,
    depth_precision,
    depth_protocols,
    depth_shapes,
    depth_waves,
    depth_zeros,
    frames,
    gradients,
    lenses,
    modulators,
    panels,
    patterns,
    pictures,
    propagations,
    pupils,
    restorations,
    retrievals,
    transforms,
)
from hard_cases.table import Case

SUBJECTS: dict[str, list[Case]] = {
    "Pupils: stops and the wave in them": pupils.CASES,
    "PSFs of lenses": lenses.CASES,
    "PSFs behind a panel": panels.CASES,
    "The camera chain": chains.CASES,
    "Modulators: grey, phase and field": modulators.CASES,
    "Fourier transforms": transforms.CASES,
    "Free space": propagations.CASES,
    "Pictures and transfer functions": pictures.CASES,
    "Derivatives": gradients.CASES,
    "Patterns and targets": patterns.CASES,
    "Patterns, frames, brackets": frames.CASES,
    "Phase retrieval": retrievals.CASES,
    "Restorations": restorations.CASES,
    "Depth of field: waves and OTFs": depth_waves.CASES,
    "Depth of field: spheres and shapes": depth_shapes.CASES,
    "Depth of field: designs": depth_designs.CASES,
    "Depth of field: mixed precision": depth_precision.CASES,
    "Depth of field: captures": depth_protocols.CASES,
    "Depth of field: restorations": depth_zeros.CASES,
}
CASES = [case for cases in SUBJECTS.values() for case in cases]

_HEAD = "| case | what goes wrong elsewhere | asked | judged by | to |\n|---|---|---|---|---|"


def listing() -> str:
    """The whole catalogue as tables in Markdown."""
    parts = [
        f"## {subject}\n\n{_HEAD}\n" + "\n".join(_row(case) for case in cases)
        for subject, cases in SUBJECTS.items()
    ]
    return "\n\n".join(parts)


def _row(case: Case) -> str:
    tols = ", ".join(f"{tol:g}" for tol in case.tols if tol)
    if case.bug:
        tols += f" (as yet it fails: {case.bug})"
    cells = (case.name, case.hard_because, case.asked(), case.judged(), tols)
    return "| {} |".format(" | ".join(cell.replace("|", "\\|") for cell in cells))
