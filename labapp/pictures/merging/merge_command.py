"""The command `labapp merge`: merge a bracket, and tell how good it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from labapp.common.console import print_json, print_message, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.output_paths import HDF5_ENDINGS
from labapp.files.picture.encoding import parse_encoding
from labapp.files.writing import make_folder, require_all_writable, write_atomically
from labapp.pictures.merging.bracket_files import BracketFiles, SensorNumbers, read_bracket_files
from labapp.pictures.merging.bracket_record import RecordedFrames, read_recorded_bracket
from labapp.pictures.merging.merge_page import (
    EXPOSURE_COLUMNS,
    accuracy_words,
    exposure_rows,
    merge_page,
    state_rows,
)
from labapp.pictures.merging.merged_bracket import file_bracket, merge_files
from labapp.pictures.merging.merged_files import describe_merged, merged_paths, write_merged
from labapp.pictures.merging.raw_bracket import find_raw_files, read_raw_bracket
from optics import hdr


@dataclass(frozen=True)
class MergeRequest:
    """What `labapp merge` was asked to do; the fields are its options.

    budget: processor seconds, by which the method is chosen; None for the method that is given.
    """

    files: list[Path]
    exposures: list[float] | None
    darks: list[Path]
    sensor: Path | None
    numbers: SensorNumbers
    frames: RecordedFrames
    encoding: str | None
    method: hdr.Method
    budget: float | None
    refine: bool
    align: bool
    out: Path
    force: bool


def merge_bracket_files(request: MergeRequest, *, as_json: bool) -> None:
    """Merge frames; write data, light, picture and report, and print what was found."""
    if request.out.suffix.lower() not in HDF5_ENDINGS:
        raise UserError(f"--out {request.out}: must end in .h5; the other files lie beside it.")
    paths = merged_paths(request.out)
    kept = {one.resolve() for one in (*request.files, *request.darks)}
    for path in paths.values():
        if path.resolve() in kept:
            raise UserError(f"--out {request.out}: {path.name} is a file that is read.")
    require_all_writable(paths.values(), force=request.force)
    source = _read(request)
    with terminal_progress() as progress:
        method = _method(request, source)
        merged = merge_files(source, method, request.refine, progress, request.align)
        progress.report(0.9, "writing")
        make_folder(request.out.parent)
        shown = write_merged(merged, paths)
        write_atomically(paths["report"], merge_page(merged, shown).encode())
    if as_json:
        print_json(describe_merged(merged) | {kind: str(path) for kind, path in paths.items()})
        return
    print_table("Exposures", EXPOSURE_COLUMNS, exposure_rows(merged))
    print_table("Pixels", ("state", "share "), state_rows(merged))
    if merged.accuracy is not None:
        print_message(f"sensor: {source.sensor_source}")
        print_message(accuracy_words(merged.method, merged.accuracy))
    for words in merged.notes:
        print_message(f"note: {words}")
    for words in merged.told:
        print_message(f"warning: {words}")
    print_message("wrote " + ", ".join(str(path) for path in paths.values()))


def _method(request: MergeRequest, source: BracketFiles) -> hdr.Method:
    """Return the method of merging: the given one, or by the budget."""
    if request.budget is None:
        return request.method
    if source.is_coded:
        raise UserError(
            "--budget: 8-bit pictures are merged by their response curve, in one way only."
        )
    try:
        return hdr.choose_method(
            file_bracket(source, 0), request.budget, machine_speed(), len(source.frames[0])
        )
    except ValueError as error:
        raise UserError(f"--budget {request.budget:g}: {error}.") from error


def _read(request: MergeRequest) -> BracketFiles:
    """Read the frames to merge, from a record or from files."""
    if any(path.suffix.lower() in HDF5_ENDINGS for path in request.files):
        if len(request.files) > 1:
            raise UserError("several files, one of them a record: give a record by itself.")
        if request.exposures is not None or request.darks:
            raise UserError("--exposures, --dark: a record has its own exposures and dark frames.")
        if request.align:
            raise UserError("--align: registers files; the frames of a record don't move.")
        return read_recorded_bracket(request.files[0], request.frames)
    if request.frames != RecordedFrames():
        raise UserError(
            "--target, --pattern, --wavelength-nm, --readout: choose frames of a record only."
        )
    raws = find_raw_files(request.files)
    encoding = parse_encoding(request.encoding) if request.encoding else None
    rest = (request.exposures, request.darks, request.sensor, request.numbers, encoding)
    if raws is None:
        return read_bracket_files(request.files, *rest)
    source = read_raw_bracket(raws, *rest)
    if request.align and source.period != (1, 1):
        raise UserError(
            "--align: pixels of RAW files have other colours than their neighbours, and can't be "
            "moved. Leave it out, or develop the files to linear 16-bit TIFFs first."
        )
    return source
