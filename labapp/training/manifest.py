"""List the pictures that something is trained on: their contents, licences and use.

The list is kept beside the trained weights, so that anybody can see what they were trained on, and
whether a test picture was among it.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import Field, RootModel

from labapp.common.errors import UserError, suggest_spelling
from labapp.files.guarded_reading import read_bytes
from labapp.files.reading import FileModel, read_file
from labapp.files.writing import write_atomically

PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"})
"""Endings of the files that are taken to be pictures; other files of a folder are left alone."""


def list_pictures(folder: Path) -> list[Path]:
    """List the pictures of a folder and the folders in it, sorted by path.

    Hidden files, such as those that a Mac leaves behind, don't count. Raises UserError if the
    folder isn't there, or has no picture.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: is not a folder. Name a folder of pictures.")
    found = [
        file
        for file in folder.rglob("*")
        if file.suffix.lower() in PICTURE_SUFFIXES
        and file.is_file()
        and not any(part.startswith(".") for part in file.relative_to(folder).parts)
    ]
    if not found:
        endings = ", ".join(sorted(PICTURE_SUFFIXES))
        raise UserError(f"{folder}: has no picture. Name a folder of pictures ({endings}).")
    return sorted(found, key=lambda file: file.relative_to(folder).as_posix())


Split = Literal["training", "validation"]
"""What a picture is used for: to change weights, or to choose between them."""

NOT_STATED = "not stated"
"""The licence of a picture for which its folder states none."""

_LICENCE_FILES = ("licences.toml", "LICENCES.toml")

_VALIDATION_SHARE = 8
"""One picture in so many is for validation. Chosen: about 25 of 200."""

_Text = Annotated[str, Field(min_length=1)]


class ManifestPicture(FileModel):
    """A picture of a training's data.

    folder: name of the folder it was in, without the folders above.
    path: in the folder, with slashes.
    sha256, bytes: checksum and size of the file.
    licence: from the folder's `licences.toml`, or "not stated".
    """

    folder: str
    path: _Text
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    bytes: Annotated[int, Field(gt=0)]
    licence: _Text
    split: Split


class LeftOutPicture(FileModel):
    """A file that was left out, as the one at `same_as` has the same bytes."""

    folder: str
    path: _Text
    same_as: _Text


class DataManifest(FileModel):
    """The pictures that something was trained on, ordered by checksum.

    longest_side: pixels of the longest side to which large pictures were averaged down, as they
    would have taken too much memory; None if they weren't.
    """

    version: Literal[1] = 1
    pictures: tuple[ManifestPicture, ...]
    left_out: tuple[LeftOutPicture, ...] = ()
    longest_side: Annotated[int, Field(gt=0)] | None = None

    @property
    def digest(self) -> str:
        """Checksum of contents, splits and size of the pictures."""
        lines = [f"{one.sha256} {one.split}" for one in self.pictures]
        return hashlib.sha256("\n".join([*lines, str(self.longest_side)]).encode()).hexdigest()

    def notes(self) -> list[str]:
        """Return what a user should know about the data, one sentence each."""
        notes = []
        silent = [one.path for one in self.pictures if one.licence == NOT_STATED]
        if silent:
            notes.append(
                f"{len(silent)} of {len(self.pictures)} pictures have no stated licence, "
                f"{silent[0]} for one: state it in {_LICENCE_FILES[0]} in their folder."
            )
        if self.left_out:
            first = self.left_out[0]
            notes.append(
                f"{len(self.left_out)} copies were left out: {first.path} is the same file as "
                f"{first.same_as}, for one."
            )
        if self.longest_side is not None:
            notes.append(
                f"Pictures were averaged down to a longest side of {self.longest_side} pixels, as "
                "they would have taken too much memory."
            )
        return notes

    def write(self, path: Path) -> None:
        """Write the list as JSON, which `read_manifest` reads."""
        text = json.dumps(self.model_dump(), indent=1, ensure_ascii=False) + "\n"
        write_atomically(path, text.encode())


def read_manifest(path: Path) -> DataManifest:
    """Read a list that `DataManifest.write` wrote; UserError if invalid."""
    return read_file(path, DataManifest)


def list_training_files(
    folders: Sequence[Path],
) -> tuple[list[tuple[Path, ManifestPicture]], tuple[LeftOutPicture, ...]]:
    """List the different pictures of folders, with licences, and split them.

    Returns files and entries ordered by checksum, so that neither names nor places of files
    influence a training, and the files with the same bytes as one that was taken. Raises UserError
    if a folder is missing or has no picture, if there is only one picture in all, or if a file of
    licences is invalid.
    folders: a file `licences.toml` in one states licences: a table from a file's name, its path in
    the folder or a pattern with * and ? to the licence's text. The first entry that fits counts; a
    pattern counts only where no name does.
    """
    if not folders:
        raise UserError("There is no folder of pictures to train on. Name one.")
    taken: dict[str, tuple[Path, ManifestPicture]] = {}
    left_out = []
    for folder in folders:
        files = list_pictures(folder)
        licences = _read_licences(folder, files)
        for file in files:
            entry = _describe(folder, file, licences[file])
            if entry.sha256 not in taken:
                taken[entry.sha256] = file, entry
            elif file.resolve() != taken[entry.sha256][0].resolve():
                same = taken[entry.sha256][1].path
                left_out.append(LeftOutPicture(folder=entry.folder, path=entry.path, same_as=same))
    splits = split_by_checksum(taken)
    listed = [
        (file, entry.model_copy(update={"split": splits[checksum]}))
        for checksum, (file, entry) in sorted(taken.items())
    ]
    return listed, tuple(left_out)


def split_by_checksum(checksums: Iterable[str]) -> dict[str, Split]:
    """Assign pictures to training and validation by their checksums alone.

    One in eight is for validation. A picture therefore stays where it is when others are added,
    unless it was needed so that neither is empty. Raises UserError for fewer than two pictures.
    """
    ordered = sorted(checksums)
    if len(ordered) < 2:
        raise UserError(
            "There is only one picture. Training and validation need different ones: add another."
        )
    splits: dict[str, Split] = {
        one: "validation" if int(one, 16) % _VALIDATION_SHARE == 0 else "training"
        for one in ordered
    }
    kinds = set(splits.values())
    if "validation" not in kinds:
        splits[ordered[0]] = "validation"
    if "training" not in kinds:
        splits[ordered[-1]] = "training"
    return splits


class _Licences(RootModel[dict[str, _Text]]):
    """A file of licences: from a name, a path or a pattern to a licence's text."""


def _describe(folder: Path, file: Path, licence: str) -> ManifestPicture:
    """Return a picture's entry, with its split still open."""
    data = read_bytes(file)
    if not data:
        raise UserError(f"{file}: is empty. Take it out of the folder, or replace it.")
    return ManifestPicture(
        folder=folder.resolve().name,
        path=file.relative_to(folder).as_posix(),
        sha256=hashlib.sha256(data).hexdigest(),
        bytes=len(data),
        licence=licence,
        split="training",
    )


def _read_licences(folder: Path, files: Sequence[Path]) -> dict[Path, str]:
    """Return the licence of each picture of a folder; UserError for a key that fits none."""
    names = {one.name for one in folder.iterdir()}
    source = next((folder / one for one in _LICENCE_FILES if one in names), None)
    table = {} if source is None else read_file(source, _Licences).root
    paths = {file: file.relative_to(folder).as_posix() for file in files}
    for key in table:
        if not any(_fits(key, path) for path in paths.values()):
            known = [*paths.values(), *(file.name for file in files)]
            raise UserError(
                f"{source}: key {key!r} fits no picture. {suggest_spelling(key, known)}"
                "Name a picture of the folder, or a pattern such as *.jpg."
            )
    found = {}
    for file, path in paths.items():
        fitting = (text for key, text in table.items() if _fits(key, path))
        found[file] = table.get(path) or table.get(file.name) or next(fitting, NOT_STATED)
    return found


def _fits(key: str, path: str) -> bool:
    """Tell whether a key of a table of licences is for a picture."""
    name = PurePosixPath(path).name
    return key in (path, name) or any(fnmatch.fnmatchcase(one, key) for one in (path, name))
