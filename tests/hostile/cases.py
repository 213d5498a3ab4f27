"""Crafted files with the commands that read them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from hostile import plain_files as plain
from hostile.hdf5_files import changed_copy, unprotected_copy
from labapp.runs.record import layout

Maker = Callable[[Path], Path]

NO_FILES: Sequence[Maker] = (
    plain.pipe, plain.device, plain.directory, plain.listener, plain.missing, plain.endless_name,
    plain.empty,
)  # fmt: skip
"""What a path can lead to instead of a file with contents."""

PICTURES: Sequence[Maker] = (
    plain.png_header, plain.png_bomb, plain.png_cut, plain.jpeg_header, plain.jpeg_scans,
    plain.bmp_header, plain.webp_header, plain.tiff_header, plain.gif,
)  # fmt: skip

TEXTS: Sequence[Maker] = (
    plain.deep_toml, plain.dotted_toml, plain.long_toml, plain.large_number_toml,
    plain.digits_toml, plain.nul_toml, plain.utf16_toml, plain.latin1_toml, plain.deep_json,
    plain.nested_json, plain.many_lists_json, plain.half_character_json,
)  # fmt: skip

ARRAYS: Sequence[Maker] = (plain.huge_npy, plain.object_npy, plain.hole_npy, plain.nan_npy)

_MERGED = ("--out", "{folder}/merged.h5", "--force")
_OUT = ("--out", "{folder}/out.png", "--force")
_BENCH = ("--bench", "{folder}/bench.toml")
_RECORD_COMMANDS: Sequence[Sequence[str]] = (
    ("show", "{file}"),
    ("verify", "{file}"),
    ("report", "{file}", "--out", "{folder}", "--force"),
    ("export", "{file}", "--to", "npy", "--out", "{folder}/frames", "--force"),
    ("resume", "{file}", "--yes"),
    ("salvage", "{file}", "--out", "{folder}/saved.h5", "--force"),
    ("reconstruct", "{file}", *_OUT),
)
_RECORD_CHANGES = (
    ("external-link", "entry/title"),
    ("soft-link", "entry/title"),
    ("external-storage", "entry/title"),
    ("external-storage", f"{layout.DATA}/images"),
    ("virtual-dataset", f"{layout.DATA}/images"),
    ("long-text", "entry/title"),
    ("bomb", f"{layout.DATA}/images"),
    ("many-texts", "entry/targets/names"),
    ("circle", ""),
)
_PATTERN_COMMANDS: Sequence[Sequence[str]] = (
    ("refine", "{file}", "--out", "{folder}/better.h5", "--force", "--yes"),
    ("reconstruct", "{folder}/picture.png", "--decoder", "{file}", *_OUT),
)
_DESIGN_CHANGES = tuple(
    (change, "entry/pattern/grey")
    for change in (
        "external-link", "external-storage", "virtual-dataset", "bomb", "many-chunks",
        "foreign-filter",
    )
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A command on a crafted file. file: its name, as far as an error has to tell it. may_pass:
    whether the command may do its work all the same.
    """

    name: str
    file: str
    arguments: tuple[str, ...]
    may_pass: bool = False


def crafted_cases(folder: Path) -> Iterator[Case]:
    """All cases, in a folder with the files of a small bench, its record and a design.

    They are run.h5, design.h5, bench.toml, scene.toml, plan.toml, picture.png and psf.npy.
    """
    yield from _record_cases(folder)
    yield from _design_cases(folder)
    yield from _picture_cases(folder)
    yield from _number_cases(folder)
    yield from _text_cases(folder)


def _case(
    folder: Path,
    file: Path,
    command: Sequence[str],
    *,
    may_pass: bool = False,
    told: Path | None = None,
) -> Case:
    """The case of a command on a file. told: the crafted file, if the command's file names it."""
    words = tuple(one.format(file=file, folder=folder) for one in command)
    option = next((a for a, b in pairwise(command) if b == "{file}"), "")
    verb = " ".join(dict.fromkeys((command[0], option)))
    crafted = told or file
    return Case(f"{verb.strip()} {crafted.name[:40]}", crafted.name[:20], words, may_pass)


def _record_cases(folder: Path) -> Iterator[Case]:
    """Records of both formats; salvage may save frames from damaged ones."""
    record = folder / "run.h5"
    bare = unprotected_copy(record, folder)
    crafted = [make(folder) for make in NO_FILES]
    for whole in (record, bare):
        crafted += [changed_copy(whole, name, kind, folder) for kind, name in _RECORD_CHANGES]
    for file in crafted:
        for command in _RECORD_COMMANDS:
            yield _case(folder, file, command, may_pass=command[0] in ("salvage", "resume"))


def _design_cases(folder: Path) -> Iterator[Case]:
    crafted = [make(folder) for make in NO_FILES]
    design = folder / "design.h5"
    crafted += [changed_copy(design, name, kind, folder) for kind, name in _DESIGN_CHANGES]
    for file in crafted:
        for command in _PATTERN_COMMANDS:
            yield _case(folder, file, command)


def _picture_cases(folder: Path) -> Iterator[Case]:
    commands: Sequence[Sequence[str]] = (
        ("reconstruct", "{file}", "--psf", "{folder}/psf.npy", *_OUT),
        ("psf", *("--camera", "{folder}/bench.toml"), "--pattern", "{file}", *_OUT),
        ("demo", "--image", "{file}", "--out", "{folder}/demo", "--force"),
        (
            "merge",
            "{file}",
            "{folder}/picture.png",
            "--exposures",
            "1,2",
            "--out",
            "{folder}/merged.h5",
            "--force",
        ),
    )
    for file in [make(folder) for make in (*NO_FILES, *PICTURES)]:
        for command in commands:
            yield _case(folder, file, command)
    # Its first page is whole.
    yield _case(folder, plain.tiff_circle(folder), commands[0], may_pass=True)


def _number_cases(folder: Path) -> Iterator[Case]:
    for make in ARRAYS:
        command = ("reconstruct", "{folder}/picture.png", "--psf", "{file}", *_OUT)
        yield _case(folder, make(folder), command)
    for make in (plain.bomb_npz, plain.broken_npz, plain.bomb_mat, plain.huge_npy, plain.hole_npy):
        array = make(folder)
        scene = _cube_scene(folder, array)
        yield _case(folder, scene, ("simulate", "{file}", *_OUT), told=array)


def _text_cases(folder: Path) -> Iterator[Case]:
    plan_commands: Sequence[Sequence[str]] = (
        ("plan", "show", "{file}", *_BENCH, "--scene", "{folder}/scene.toml"),
        ("plan", "show", "{folder}/plan.toml", "--bench", "{file}"),
        ("plan", "show", "{folder}/plan.toml", *_BENCH, "--scene", "{file}"),
    )
    for file in [make(folder) for make in (*NO_FILES, *TEXTS)]:
        for command in plan_commands:
            yield _case(folder, file, command)
    yield _case(folder, plain.endless_plan(folder), plan_commands[0])
    yield _case(folder, plain.nul_path_scene(folder), plan_commands[2])
    pictures = (plain.device, plain.pipe, plain.png_header)
    for file in [make(folder) for make in pictures]:
        scene = plain.picture_scene(folder, file)
        yield _case(folder, scene, plan_commands[2], told=file)
    for make in (plain.quoted_table, plain.long_cell_table, plain.nan_table, plain.pipe):
        table = make(folder)
        bench = _curve_bench(folder, table)
        yield _case(folder, bench, plan_commands[1], told=table)


def _curve_bench(folder: Path, table: Path) -> Path:
    """A bench file whose sensor's quantum efficiency is a table of its own."""
    text = (folder / "bench.toml").read_text()
    old = "quantum_efficiency = 0.62"
    assert old in text
    path = folder / f"bench-{table.stem}.toml"
    path.write_text(text.replace(old, f'quantum_efficiency = {{ file = "{table.name}" }}'))
    return path


def _cube_scene(folder: Path, array: Path) -> Path:
    """A scene of a cube in a file of numbers."""
    path = folder / f"scene-{array.name}.toml"
    path.write_text(
        'version = 2\ntitle = ""\n[lights.lamp]\nkind = "flat"\n[targets.dark]\nkind = "dark"\n'
        f'[targets.cube]\nkind = "cube"\nfile = "{array.name}"\ndistance_m = 2.0\n'
        "wavelengths_nm = [500, 600]\nwhite = 1.0\n"
    )
    return path
