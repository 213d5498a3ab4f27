"""Report the result of a refinement as text, and give advice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labapp.common.console import out, print_json, print_message, print_table
from labapp.refining.result import RefinementResult


def print_report(result: RefinementResult, files: list[Path], *, as_json: bool) -> None:
    """Print the errors of all pictures, advice, and the files written."""
    if as_json:
        print_json(report_data(result, files))
        return
    columns = ["picture", "error of the shape ", "noise alone ", "speckle contrast ", "record"]
    print_table(result.start.spec.label, columns, _rows(result))
    for line in advice(result):
        print_message(line)
    wrote = [f"wrote {file}" for file in files]
    wrote.append(f"records in {result.pictures[0].record.parent}")
    out.print("\n".join(wrote), soft_wrap=True)


def report_data(result: RefinementResult, files: list[Path]) -> dict[str, Any]:
    return {
        "pattern": result.start.spec.label,
        "files": [str(file) for file in files],
        **result.refinement_record,
        "advice": advice(result),
    }


def warn_of_missing_registration() -> None:
    """Warn that no registration of panel and sensor is in force."""
    print_message(
        "no registration is in force: the star is taken to be seen in the middle of the sensor, "
        "with nothing turned or mirrored, by the bench file's distances. If that isn't so, "
        "calibrate this bench first: labapp calibrate"
    )


def advice(result: RefinementResult) -> list[str]:
    """Say what would give a better result; empty if nothing."""
    said, best = [], result.pictures[result.best]
    if result.best == 0:
        said.append(
            "no picture was better than the first: the design is as good as it was. Calibrate the "
            "wavefront, check the registration, or take more pictures (--pictures)."
        )
    # The zeroth order makes more than half of the squared error.
    if best.central > 0.5:
        said.append(
            f"{best.central:.0%} of the error that is left is light in the middle: what the panel "
            "doesn't modulate stays there, whatever is shown. Design a shape beside the axis."
        )
    # Noise makes more than half of the error.
    if best.noise > 0.5 * best.nrmse:
        said.append(
            "much of the error that is left is noise of the pictures: expose longer "
            "(--exposures-ms)."
        )
    if result.best == len(result.pictures) - 1 and result.best > 0:
        said.append("the last picture was the best one: more of them may gain more (--pictures).")
    return said


def _rows(result: RefinementResult) -> list[list[str]]:
    return [
        [
            f"{number + 1}{' (best)' if number == result.best else ''}",
            f"{seen.nrmse:.4f}",
            f"{seen.noise:.4f}",
            f"{seen.contrast:.4f}",
            seen.record.name,
        ]
        for number, seen in enumerate(result.pictures)
    ]
