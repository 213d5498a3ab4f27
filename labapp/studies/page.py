"""The files that a study writes beside its record: a picture, an HTML page, and JSON data."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import labapp
from labapp.common.figure_png import figure_to_png
from labapp.files.key_values import describe_keys
from labapp.files.output_paths import STUDY_FILES
from labapp.files.writing import write_atomically
from labapp.pictures.report.html import document, footer, heading, html_figure, html_table
from labapp.studies.contract import Study, StudyResults, StudySettings


@dataclass(frozen=True, eq=False)
class CompletedStudy:
    """Hold a completed study with its settings, record and results.

    stage_seconds: wall-clock time of each stage.
    """

    name: str
    study: Study[Any]
    settings: StudySettings
    seed: int
    record: Path
    simulated_devices: list[str]
    results: StudyResults
    stage_seconds: Mapping[str, float]

    @property
    def simulation_badge(self) -> str:
        listed = ", ".join(self.simulated_devices)
        return f"SIMULATED: {listed}" if self.simulated_devices else "real devices"


def write_study_files(account: CompletedStudy, folder: Path) -> None:
    """Write picture, page and data; each file gets its name only when it is complete."""
    pictures = [figure_to_png(plate.figure) for plate in account.results.figures]
    write_atomically(folder / STUDY_FILES[0], pictures[0])
    write_atomically(folder / STUDY_FILES[1], study_html(account, pictures).encode())
    text = json.dumps(study_as_data(account), indent=2, allow_nan=False, ensure_ascii=False)
    write_atomically(folder / STUDY_FILES[2], f"{text}\n".encode())


def study_html(account: CompletedStudy, pictures: list[bytes]) -> str:
    """Return a page as HTML; `pictures` are its figures as PNG files."""
    study, results = account.study, account.results
    rows = [[row.what, row.published, row.expected, row.ours] for row in results.rows]
    plates = [
        f"<h2>{escape(plate.title)}</h2>" + html_figure(picture, plate.caption)
        for plate, picture in zip(results.figures, pictures, strict=True)
    ]
    movies = [
        f"<h2>{escape(movie.title)}</h2>" + html_figure(movie.data, movie.caption, "gif")
        for movie in results.animations
    ]
    values = account.settings.model_dump(mode="json")
    settings = [
        [one["key"], json.dumps(values[one["key"]], ensure_ascii=False), one["what"]]
        for one in describe_keys(type(account.settings))
    ]
    return document(
        study.title,
        [
            heading(study.title, account.simulated_devices),
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
            html_table(["key", "value", "what it is"], settings),
            f"<p>Seed {account.seed}; record {escape(account.record.name)}.</p>",
            "<h2>Time</h2>",
            html_table(
                ["stage", "s "], [[k, f"{v:.2f}"] for k, v in account.stage_seconds.items()]
            ),
            footer(),
        ],
    )


def study_as_data(account: CompletedStudy) -> dict[str, Any]:
    """Return all results but the figures, as plain data for JSON."""
    results = account.results
    rows = [asdict(row) for row in results.rows]
    for row in rows:
        # JSON can't express what isn't finite.
        if row["value"] is not None and not math.isfinite(row["value"]):
            row["value"] = None
    return {
        "study": account.name,
        "title": account.study.title,
        "source": account.study.source,
        "shows": account.study.shows,
        "settings": account.settings.model_dump(mode="json"),
        "seed": account.seed,
        "record": account.record.name,
        "simulated": account.simulated_devices,
        "rows": rows,
        "notes": list(results.notes),
        "data": dict(results.data),
        "seconds": dict(account.stage_seconds),
        "version": labapp.__version__,
    }
