"""The paths of a command's output files, and whether they have known endings and may be written.

Commands check their output paths before they load the slow modules that compute the results. What
can't be written raises UserError.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.writing import require_all_writable, require_free_names

HDF5_ENDINGS = (".h5", ".hdf5")
ENVI_ENDING = ".hdr"
ENVI_DATA_ENDING = ".raw"


def cube_paths(path: Path) -> tuple[Path, ...]:
    """Return the paths that hold a cube: one of HDF5, or a header and the data of ENVI.

    The ending, .h5, .hdf5 or .hdr, chooses the format; UserError for another.
    """
    ending = path.suffix.lower()
    if ending in HDF5_ENDINGS:
        return (path,)
    if ending == ENVI_ENDING:
        return path, path.with_suffix(ENVI_DATA_ENDING)
    raise UserError(
        f"{path}: the ending says the kind of a cube; name it .h5 (HDF5, with all that is known), "
        "or .hdr (ENVI, with a .raw beside it)."
    )


RECORD = "run.h5"
REPORT_FILES = ("report.png", "report.html")
STUDY_FILES = ("study.png", "study.html", "study.json")
ACCURACY_FILES = ("accuracy.html", "accuracy.json")

_DESIGN_ENDINGS = (".h5", ".hdf5")
_PATTERN_ENDINGS = (".png", ".h5")
_PSF_ENDINGS = (".npy", ".tiff", ".png")
_TIFF = (".tif", ".tiff")


def is_design(path: Path) -> bool:
    """Whether a name has the ending of a design."""
    return path.suffix.lower() in _DESIGN_ENDINGS


def require_photograph_ending(path: Path) -> None:
    """Raise UserError if a photograph can't be written with this ending."""
    if path.suffix.lower() not in (".npy", ".png", ".exr", ".hdr", *_TIFF):
        raise UserError(
            f"{path}: the ending says the kind; choose .tiff, .npy, .exr, .hdr or .png."
        )


def weights_output_path(path: Path, *, force: bool) -> Path:
    """Return the path for a neural network's weights; raise UserError if it can't be written."""
    if path.suffix != ".npz":
        raise UserError(f"--out {path}: weights are written as .npz. Name such a file.")
    require_all_writable((path,), force=force)
    return path


def run_output_paths(plans: Sequence[Path], record: Path, *, force: bool) -> list[Path]:
    """Return the paths of the records that plans are run to.

    A single plan is recorded in the file `record`. If there are several plans, or `record` is a
    folder, each plan has a record in that folder, named after the plan.
    """
    if len(plans) == 1 and not record.is_dir():
        require_all_writable((record,), force=force)
        return [record]
    names = [f"{plan.stem}.h5" for plan in plans]
    require_free_names(record, names, force=force)
    return [record / name for name in names]


def accuracy_folder(folder: Path | None, *, force: bool) -> Path:
    """Return the folder of the accuracy page; a dated one if none is named."""
    found = folder or Path(f"accuracy_{datetime.now():%Y-%m-%d_%H%M%S}")
    require_free_names(found, ACCURACY_FILES, force=force)
    parent = next(path for path in (found, *found.absolute().parents) if path.exists())
    if not (parent.is_dir() and os.access(parent, os.W_OK)):
        raise UserError(f"--out {found}: {parent} may not be written to. Choose another place.")
    return found


def psf_output_paths(path: Path, *, force: bool) -> tuple[Path, Path]:
    """Return the paths of a PSF and of its picture; the same one if it is a .png."""
    _require_one_of(path, _PSF_ENDINGS)
    picture = path.with_suffix(".png")
    require_all_writable(dict.fromkeys((path, picture)), force=force)
    return path, picture


def edof_output_paths(path: Path, *, force: bool) -> tuple[Path, Path, Path]:
    """Return the paths of a design for depth of field: design, pattern, and its picture."""
    if not is_design(path):
        raise UserError(f"--out {path}: a design is written as .h5. Name such a file.")
    picture = path.with_name(f"{path.stem}_design.png")
    files = (path, path.with_suffix(".png"), picture)
    require_all_writable(files, force=force)
    return files


def trained_output_paths(path: Path, *, force: bool) -> tuple[Path, Path, Path, Path]:
    """Return the paths of a trained pattern: design, pattern, picture, list of data."""
    if not is_design(path):
        raise UserError(f"--out {path}: pattern and decoder are written as .h5. Name such a file.")
    picture, listed = (f"{path.stem}_training.png", f"{path.stem}_data.json")
    files = (path, path.with_suffix(".png"), path.with_name(picture), path.with_name(listed))
    require_all_writable(files, force=force)
    return files


def beam_output_path(path: Path, *, force: bool) -> Path:
    """Return the path for a picture of the beam along the axis; it must end in .png."""
    if path.suffix.lower() != ".png":
        raise UserError(f"{path}: the ending must be .png.")
    require_all_writable((path,), force=force)
    return path


def pattern_output_paths(path: Path, frames: int, *, force: bool) -> tuple[list[Path], Path]:
    """Return the paths of a pattern's frames, pictures or one design, and of its PSF's picture."""
    _require_one_of(path, _PATTERN_ENDINGS)
    files = [path]
    if frames > 1 and not is_design(path):
        digits = max(3, len(str(frames - 1)))
        files = [path.with_name(f"{path.stem}_{k:0{digits}}{path.suffix}") for k in range(frames)]
    drawn = path.with_name(f"{path.stem}_psf.png")
    require_all_writable((*files, drawn), force=force)
    return files, drawn


def frames_output_path(path: Path, frames: int, *, force: bool) -> tuple[Path, str]:
    """Return the path of simulated frames, and its format: png, tiff or h5."""
    if frames < 1:
        raise UserError(f"--frames {frames}: ask for one at least.")
    ending = path.suffix.lower()
    if ending == ".png" and frames > 1:
        raise UserError(f"--out {path}: a .png holds one frame; take .h5 or .tiff for more.")
    kinds = {".png": "png", **dict.fromkeys(_TIFF, "tiff"), **dict.fromkeys(_DESIGN_ENDINGS, "h5")}
    if ending not in kinds:
        raise UserError(f"--out {path}: the ending says the kind; choose .h5, .tiff or .png.")
    require_all_writable((path,), force=force)
    return path, kinds[ending]


def restoration_output_paths(
    source: Path,
    data: Path | None,
    picture: Path | None,
    inputs: Sequence[Path | None],
    *,
    blind: bool,
    force: bool,
) -> tuple[Path, Path, Path | None]:
    """Return the paths of a restoration: photograph, comparison, estimated PSF.

    The PSF has a file only in a blind deconvolution. Files that aren't named are placed beside
    `source`, the photograph. `inputs` are other input files, which may not be replaced.
    """
    data = data or source.with_name(f"{source.stem}_restored.tiff")
    picture = picture or data.with_name(f"{data.stem}_before_after.png")
    require_photograph_ending(data)
    if picture.suffix.lower() != ".png":
        raise UserError(f"--picture {picture}: must end in .png.")
    if data.resolve() == picture.resolve():
        raise UserError(f"--out and --picture are both {data}. Give each its own file.")
    kept = {one.resolve() for one in (source, *inputs) if one is not None}
    for option, file in (("--out", data), ("--picture", picture)):
        if file.resolve() in kept:
            raise UserError(f"{option} {file}: is a file that is read. Choose another name.")
    found = data.with_name(f"{data.stem}_psf.npy") if blind else None
    require_all_writable((data, picture, found), force=force)
    return data, picture, found


def spectral_output_paths(
    source: Path,
    cube: Path | None,
    picture: Path | None,
    inputs: Sequence[Path | None],
    *,
    force: bool,
) -> tuple[Path, Path, Path]:
    """Return the paths of a spectral restoration: cube, colours, drawing.

    Files that aren't named are placed beside `source`, the record, and the colours beside the cube.
    `inputs` are other input files, which may not be replaced.
    """
    cube = cube or source.with_name(f"{source.stem}_cube.h5")
    colours = cube.with_name(f"{cube.stem}_colours.png")
    picture = picture or cube.with_name(f"{cube.stem}_bands.png")
    if picture.suffix.lower() != ".png":
        raise UserError(f"--picture {picture}: must end in .png.")
    if picture.resolve() == colours.resolve():
        raise UserError(f"--picture {picture}: is the file of the colours. Choose another name.")
    kept = {one.resolve() for one in (source, *inputs) if one is not None}
    written = (*cube_paths(cube), colours, picture)
    for file in written:
        if file.resolve() in kept:
            raise UserError(
                f"{file}: is a file that is read. Choose another name: --out, --picture."
            )
    require_all_writable(written, force=force)
    return cube, colours, picture


def _require_one_of(path: Path, endings: Sequence[str]) -> None:
    if path.suffix.lower() not in endings:
        raise UserError(f"{path}: the ending must be one of {', '.join(endings)}.")
