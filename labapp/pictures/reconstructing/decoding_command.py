"""`labapp reconstruct --decoder`: decode a photograph, and write it with before and after."""

from __future__ import annotations

from typing import Any

from labapp.common.console import out, print_json, print_message, print_table, terminal_progress
from labapp.edof.trained_pattern import decoder_data, describe_decoder
from labapp.files.writing import write_atomically
from labapp.pictures.reconstructing.before_after import draw_before_decoded
from labapp.pictures.reconstructing.command import OutputFiles, score_as_data, score_rows
from labapp.pictures.reconstructing.decoding import DecodedPhotograph, decode_photograph
from labapp.pictures.reconstructing.decoding_request import DecodingProblem, DecodingRequest

_NEUTRAL_IS_BLURRED = (
    "The neutral photograph is sharp at the lens' focus alone: where the scene is at other depths, "
    "scores against it take its blur for the truth."
)


def decode_for_command(request: DecodingRequest, files: OutputFiles, *, as_json: bool) -> None:
    """Decode a photograph, score it, write the files, and print the results.

    Raises UserError for a photograph or decoder that can't be used, or that don't belong together.
    """
    with terminal_progress() as progress:
        posed = request.read_problem(progress.part(0, 0.7))
        decoded = decode_photograph(posed, progress.part(0.7, 0.9))
        progress.report(0.9, "drawing")
        drawn = draw_before_decoded(posed, decoded, _captions(posed, decoded))
        data = posed.problem.encode_file(files.data, decoded.light)
        progress.report(1, "writing")
    write_atomically(files.data, data)
    write_atomically(files.picture, drawn)
    if as_json:
        print_json(_as_data(posed, decoded, files))
        return
    print_table(posed.problem.source, ["", "value"], _rows(posed, decoded))
    for note in _notes(posed, decoded):
        print_message(f"note: {note}")
    for file in (files.data, files.picture):
        out.print(f"wrote {file}", soft_wrap=True)


def _captions(posed: DecodingProblem, decoded: DecodedPhotograph) -> tuple[str, str]:
    """Return the titles before and after decoding.

    Scores against a neutral photograph, which is blurred itself, aren't put on a picture.
    """
    if decoded.scores is None or posed.truth_is_blurred:
        return "Before", "Decoded, blind"
    before, after = decoded.scores
    return f"Before: {before.psnr:.2f} dB", f"Decoded, blind: {after.psnr:.2f} dB"


def _notes(posed: DecodingProblem, decoded: DecodedPhotograph) -> list[str]:
    """Return the remarks on the decoding, and on what it is scored against."""
    blurred = [_NEUTRAL_IS_BLURRED] if posed.truth_is_blurred else []
    return [*decoded.notes, *blurred]


def _rows(posed: DecodingProblem, decoded: DecodedPhotograph) -> list[list[str]]:
    """Return the printed rows: decoder, pattern, levels, time and scores."""
    problem = posed.problem
    share = f"{posed.noise / posed.white:.2g} of white"
    rows = [["method", describe_decoder(posed.pattern)]]
    if posed.strehl is not None:
        rows.append(["pattern", f"as in training, Strehl ratio {posed.strehl:.4f}"])
    if posed.pattern.binning > 1:
        rows.append(["pixels", f"means of {posed.pattern.binning} x {posed.pattern.binning}"])
    rows += [
        ["white", f"{posed.white:.4g} {problem.unit}"],
        [
            "noise",
            f"{posed.noise:.3g} {problem.unit}, {share}, {problem.noise_source(posed.noise)}",
        ],
        ["clipped pixels", f"{posed.clipped}, taken as full wells"],
        ["dead pixels", f"{posed.dead}, filled"],
        ["processor time", f"{decoded.cpu_seconds:.2f} s"],
    ]
    return rows + score_rows(problem.reference, decoded.scores)


def _as_data(
    posed: DecodingProblem, decoded: DecodedPhotograph, files: OutputFiles
) -> dict[str, Any]:
    """Return what the decoding gave, for JSON."""
    problem = posed.problem
    return {
        "source": problem.source,
        "method": "decoder",
        "blind": posed.pattern.network.settings.is_blind,
        "decoder": decoder_data(posed.pattern),
        "strehl": posed.strehl,
        "unit": problem.unit,
        "white": posed.white,
        "noise": posed.noise,
        "noise_told": problem.noise is not None,
        "clipped_pixels": posed.clipped,
        "dead_pixels": posed.dead,
        "cpu_s": decoded.cpu_seconds,
        "score": score_as_data(problem.reference, decoded.scores),
        "notes": _notes(posed, decoded),
        "file": str(files.data),
        "picture": str(files.picture),
    }
