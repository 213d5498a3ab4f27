"""What a study leaves beside its record: a picture, a page, and figures for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import labapp
from labapp.common.drawing import png
from labapp.files.keys import described_keys
from labapp.files.places import STUDY_FILES
from labapp.files.writing import write_whole
from labapp.pictures.report.html import document, footer, heading, html_figure, html_table
from labapp.studies.contract import Results, Settings, Study


@dataclass(frozen=True, eq=False)
class Account:
    """A study that was done. seconds: wall-clock time of its stages."""

    name: str
    study: Study[Any]
    settings: Settings
    seed: int
    record: Path
    simulated: list[str]
    results: Results
    seconds: Mapping[str, float]

    @property
    def badge(self) -> str:
        listed = ", ".join(self.simulated)
        return f"SIMULATED: {listed}" if self.simulated else "real devices"


def write(account: Account, folder: Path) -> None:
    """Write the files of STUDY_FILES; each takes its name only when it is whole."""
    pictures = [png(plate.figure) for plate in account.results.plates]
    write_whole(folder / STUDY_FILES[0], pictures[0])
    write_whole(folder / STUDY_FILES[1], page(account, pictures).encode())
    text = json.dumps(as_data(account), indent=2, allow_nan=False, ensure_ascii=False)
    write_whole(folder / STUDY_FILES[2], f"{text}\n".encode())


def page(account: Account, pictures: list[bytes]) -> str:
    """The study as HTML text. pictures: PNG files of its plates."""
    study, results = account.study, account.results
    rows = [[row.what, row.published, row.expected, row.ours] for row in results.rows]
    plates = [
        f"<h2>{escape(plate.title)}</h2>" + html_figure(picture, plate.caption)
        for plate, picture in zip(results.plates, pictures, strict=True)
    ]
    movies = [
        f"<h2>{escape(movie.title)}</h2>" + html_figure(movie.data, movie.caption, "gif")
        for movie in results.movies
    ]
    return document(
        study.title,
        [
            heading(study.title, account.simulated),
            f"<p>{escape(study.source)} of the thesis Programmable Optics for Computational "
            "Photography, done again.</p>",
            f"<p><b>Published.</b> {escape(study.shows)}</p>",
            f"<p><b>Here.</b> {escape(study.method)}</p>",
            "<h2>Published beside ours</h2>",
            html_table(["what", "published", "expected", "ours"], rows),
            *(f"<p>{escape(note)}</p>" for note in results.notes),
            *plates,
            *movies,
            "<h2>Settings</h2>",
            html_table(["key", "value", "what it is"], _settings(account)),
            f"<p>Seed {account.seed}; record {escape(account.record.name)}.</p>",
            "<h2>Time</h2>",
            html_table(["stage", "s "], [[k, f"{v:.2f}"] for k, v in account.seconds.items()]),
            footer(),
        ],
    )


def as_data(account: Account) -> dict[str, Any]:
    """Everything but the pictures, as plain data."""
    results = account.results
    return {
        "study": account.name,
        "title": account.study.title,
        "source": account.study.source,
        "shows": account.study.shows,
        "settings": account.settings.model_dump(mode="json"),
        "seed": account.seed,
        "record": account.record.name,
        "simulated": account.simulated,
        "rows": [_finite(asdict(row)) for row in results.rows],
        "notes": list(results.notes),
        "data": dict(results.data),
        "seconds": dict(account.seconds),
        "version": labapp.__version__,
    }


def _settings(account: Account) -> list[list[str]]:
    values = account.settings.model_dump(mode="json")
    return [
        [one["key"], json.dumps(values[one["key"]], ensure_ascii=False), one["what"]]
        for one in described_keys(type(account.settings))
    ]


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """JSON has no words for infinities."""
    value = row["value"]
    return row | {"value": value if value is None or math.isfinite(value) else None}
