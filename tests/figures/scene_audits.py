"""What the plans of the bundled scenes leave out, put back by `labapp explain --audit`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from figures import Figure
from figures.where import ENVIRONMENT, ROOT
from labapp.common.console import print_message

_PATTERNS = {
    "neutral": (),
    "lens": ("lens", "focal_length_m=8"),
    "blazed grating": ("blaze", "period_px=5.3", "angle_deg=20"),
    "axicon": ("axicon", "radius_um=120"),
    "patches": ("patches", "rows=40", "columns=60"),
    "cubic": ("cubic", "strength_rad=40"),
}
"""Kinds of patterns that move, split, spread and scatter light, with their keys."""


def scene_audits_figure(folder: Path) -> list[Figure]:
    """Each bundled scene behind each pattern, by estimates and by bounds."""
    shown = [_pattern_options(folder, name) for name in _PATTERNS]
    scenes = sorted(one.stem for one in (ROOT / "labapp/data/scenes").glob("*.toml"))
    return [_figure(scenes, shown, mode) for mode in ("estimate", "bound")]


def _pattern_options(folder: Path, name: str) -> list[str]:
    if not (words := _PATTERNS[name]):
        return []
    file = folder / f"{words[0]}.png"
    _labapp("pattern", *words, "--out", str(file))
    return ["--pattern", str(file)]


def _figure(scenes: list[str], shown: list[list[str]], mode: str) -> Figure:
    broken, failed, tried, most = list[str](), list[str](), 0, 0.0
    for scene in scenes:
        for options in shown:
            case = f"{scene}, {Path(options[-1]).stem if options else 'neutral'}"
            asked = [scene, "--audit", "--pairs", "4", "--decide-by", mode, "--json", *options]
            done = _labapp("explain", *asked)
            audits: list[dict[str, Any]] = json.loads(done.stdout or "{}").get("audit", [])
            tried += len(audits)
            most = max([most, *(one["share"] or 0.0 for one in audits)])
            wrong = [one for one in audits if one["broken"]]
            broken += [f"{case}: {_in_words(one)}" for one in wrong]
            if done.returncode != bool(wrong) or not audits:
                failed.append(f"{case}: exit {done.returncode} {done.stderr[-200:]}")
            for line in (broken[-len(wrong) :] if wrong else []) + failed[-1:] * (not audits):
                print_message(f"{mode}: {line}")
    first = "".join(f"; first: {one}" for one in (broken + failed)[:1])
    return Figure(
        f"{len(scenes)} bundled scenes x {len(shown)} patterns, by {mode}s: audits beyond what "
        "the plan told; runs that failed",
        "0; 0",
        f"{len(broken)} of {tried}, largest {most:.2f} of it; {len(failed)}{first}",
        tried > 0 and not broken and not failed,
    )


def _in_words(one: dict[str, Any]) -> str:
    share = "∞" if one["share"] is None else f"{one['share']:.2f}"
    return f"{' + '.join(one['effects'])}, others {one['others']}: {share} of it"


def _labapp(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "labapp", *words],
        cwd=ROOT, env=ENVIRONMENT | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


MEASUREMENTS = {"scene audits": scene_audits_figure}
