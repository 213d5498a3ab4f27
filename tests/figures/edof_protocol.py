"""Patterns for depth of field, judged on photographs that nothing was designed or trained on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import torch

from figures import Figure
from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.decoders import BlindDecoder, blind_wiener, measure_training_spectrum
from optics.edof.evaluation import evaluate_patterns
from optics.edof.panel_transfer import QuarterTransfer
from optics.edof.pattern_search import design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM
from optics.edof.protocol import AUTHORS, HIGH_NOISE, STRICT, EdofProtocol
from optics.edof.protocol_psfs import PupilPattern
from optics.edof.scoring import CaptureScores, EvaluationTable, ScoreRow, compare_scores
from optics.edof.transfer_design import TransferDesign
from optics.patterns import (
    cubic_phase_mask,
    even_vergences,
    focal_sweep_axicon,
    logarithmic_asphere,
    multi_focus_rings,
)
from optics.quarter_symmetry import crop_quarter
from optics.threads import single_threaded

DATA = Path(__file__).parents[3] / "shared/data/natural"

JUDGED = ("01", "04", "07", "11", "15", "18", "22", "24")
"""Numbers of the Kodak photographs: every third of those that are there, and the last."""

CAMERA = Camera(Panel(unmodulated=0.0), Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
"""The thesis' camera of chapter 5: the panel is its stop."""

_WAVELENGTH, _NOISE = 520e-9, 0.008
_SIZE, _STEPS, _SEED = 512, 2000, 1
"""Pixels of the pictures, and steps, of a design."""

_LOW_GOAL, _HIGH_GOAL = 22.3, 21.2
_OFF_GRID_GOAL, _WORST_GOAL, _GAIN_GOAL = 0.2, 19.5, 0.7
_BORDER_GOALS = {"frame": 1.3, "centre": 0.3}
_AUTHORS_GOAL = 29.5
_BASELINE_GOALS = {"cubic, 1 wave": 19.0, "cubic": 20.2, "log asphere": 21.0, "rings": 21.6}
_BASELINE_ERROR = 0.3
"""Goals in dB. The baselines' are those of an independent study, on two of Kodak's photographs."""

SCENE_SIDE = 1536
"""Pixels to which the shortest edge of a photograph is resized whose border is true."""

_CUBICS = (10.0, 20.0, 40.0)
"""Waves of the cubic masks of which the best counts."""


@single_threaded
def edof_protocol_figures(folder: Path) -> list[Figure]:
    """Strict protocol with both noises, a true border, and the published simulation's protocol."""
    if not (DATA / "kodak").is_dir():
        why = "not measured: the photographs aren't beside the checkout"
        return [Figure("patterns for depth of field on photographs", "see the goals", why, None)]
    return [*strict_figures(JUDGED), *border_figures(), authors_figure()]


@dataclass(frozen=True, eq=False)
class _Strict:
    """The strict protocol's tables with low and with high noise."""

    low: EvaluationTable
    high: EvaluationTable


def strict_figures(names: Sequence[str]) -> list[Figure]:
    """The designed pattern beside hand-made ones: periodic scenes, one Wiener filter."""
    pictures = [read_photograph(DATA / f"kodak/kodim{name}.png") for name in names]
    decoder = _wiener(STRICT)
    made = hand_made()
    designed = PupilPattern("designed", design(STRICT))
    low = _evaluate([designed, *made], pictures, STRICT, decoder)
    high = _evaluate([designed], pictures, STRICT.with_noise(HIGH_NOISE), decoder)
    rows = {one.name: _row(low, one.name) for one in made}
    return [
        *_designed_figures(_row(low, "designed"), _row(high, "designed"), len(names)),
        *(_gain_figure(_row(low, "designed"), rows[name]) for name in _best_hand_made(rows)),
        *(_baseline_figure(name, goal, rows) for name, goal in _BASELINE_GOALS.items()),
        _stop_figure(low),
    ]


def _designed_figures(low: ScoreRow, high: ScoreRow, pictures: int) -> list[Figure]:
    """What the designed pattern reaches by itself."""
    scores = low.scores
    apart = scores.on_grid - scores.off_grid
    depth, worst = scores.worst
    levels = (scores.on_grid, high.scores.on_grid)
    alarms = [alarm.message for row in (low, high) for alarm in row.alarms]
    return [
        Figure(
            "designed pattern, blind Wiener, ten distances, low / high noise",
            f"≥ {_LOW_GOAL:g} / {_HIGH_GOAL:g} dB, no alarm",
            f"{levels[0]:.2f} / {levels[1]:.2f} dB, {pictures} photographs, "
            f"{100 * low.energies[0]:.1f} % of the light at least{_told(alarms)}",
            levels[0] >= _LOW_GOAL and levels[1] >= _HIGH_GOAL and not alarms,
        ),
        Figure(
            "the same, ten distances over forty random depths",
            f"≤ {_OFF_GRID_GOAL:g} dB",
            f"{apart:+.2f} dB, {scores.on_grid:.2f} and {scores.off_grid:.2f} dB",
            apart <= _OFF_GRID_GOAL,
        ),
        Figure(
            "the same, worst of all fifty depths",
            f"≥ {_WORST_GOAL:g} dB",
            f"{worst:.2f} dB at {depth:.2f} dioptres",
            worst >= _WORST_GOAL,
        ),
    ]


def _told(alarms: Sequence[str]) -> str:
    return f"; alarm: {alarms[0]}" if alarms else ""


def _best_hand_made(rows: dict[str, ScoreRow]) -> list[str]:
    """Return the best hand-made patterns: that of the literature, and the project's own if better.

    A focus that is swept several times over the radius isn't in the literature.
    """
    known = max((name for name in rows if name != "sweep"), key=lambda name: rows[name].scores.mean)
    return [known, "sweep"] if rows["sweep"].scores.mean > rows[known].scores.mean else [known]


def _gain_figure(designed: ScoreRow, other: ScoreRow) -> Figure:
    """Paired by photographs, on the grid of ten distances and beside it."""
    pairs = [
        compare_scores(cut(designed.scores), cut(other.scores)) for cut in (_on_grid, _off_grid)
    ]
    return Figure(
        f"designed pattern over {other.pattern}, hand-made, same decoder, on / off the grid",
        f"≥ {_GAIN_GOAL:g} dB",
        " / ".join(f"{one.mean:+.2f} ± {one.standard_error:.2f} dB" for one in pairs)
        + f" over {other.scores.on_grid:.2f} / {other.scores.off_grid:.2f} dB; "
        + f"worst depth {designed.scores.worst[1]:.2f} over {other.scores.worst[1]:.2f} dB",
        all(one.mean >= _GAIN_GOAL for one in pairs),
    )


def _on_grid(scores: CaptureScores) -> CaptureScores:
    return _some_depths(scores, slice(scores.on_grid_count))


def _off_grid(scores: CaptureScores) -> CaptureScores:
    return _some_depths(scores, slice(scores.on_grid_count, None))


def _some_depths(scores: CaptureScores, part: slice) -> CaptureScores:
    return replace(scores, dioptres=scores.dioptres[part], psnr=scores.psnr[:, part])


def _baseline_figure(name: str, goal: float, rows: dict[str, ScoreRow]) -> Figure:
    """The best of the patterns whose name begins so."""
    kin = [row for found, row in rows.items() if found == name or found.startswith(f"{name} ")]
    best = max(kin, key=lambda row: row.scores.on_grid)
    level = best.scores.on_grid
    return Figure(
        f"{name}, hand-made, blind Wiener, ten distances, low noise",
        f"within {_BASELINE_ERROR:g} dB of {goal:g}",
        f"{level:.2f} dB, off the grid {best.scores.off_grid:.2f} dB ({best.pattern})",
        abs(level - goal) <= _BASELINE_ERROR,
    )


def _stop_figure(table: EvaluationTable) -> Figure:
    """A small stop has the depth of field of a hole, and its light."""
    stops = [row for row in table.rows if row.pattern.startswith("stop") and row.part == "frame"]
    best = max(stops, key=lambda row: row.scores.mean)
    designed = _row(table, "designed").scores.mean
    return Figure(
        "designed pattern over the best stop of 1, 2 and 4 mm, whose noise grows with lost light",
        "better",
        f"{designed:.2f} over {best.scores.mean:.2f} dB ({best.pattern})",
        designed > best.scores.mean,
    )


def border_figures() -> list[Figure]:
    """The same scenes with what lies beyond the frame, and as if they were periodic."""
    pictures = unsplash(slice(3, 6))
    resized = replace(STRICT, shortest_edge=SCENE_SIDE)
    decoder, designed = _wiener(resized), PupilPattern("designed", design(STRICT))
    true, periodic = (
        _evaluate([designed], pictures, resized.with_border(border), decoder)
        for border in ("true", "periodic")
    )
    figures = []
    for part, goal in _BORDER_GOALS.items():
        found = [
            one.find("designed", decoder.name, part=part).scores.mean  # type: ignore[arg-type]
            for one in (periodic, true)
        ]
        figures.append(
            Figure(
                f"loss by an unknown border over a periodic one, {part}",
                f"≤ {goal:g} dB",
                f"{found[0] - found[1]:.2f} dB, {found[1]:.2f} of {found[0]:.2f} dB, "
                f"{len(pictures)} photographs",
                found[0] - found[1] <= goal,
            )
        )
    return figures


def authors_figure() -> Figure:
    """Pixels five times larger, photographs of 2048 pixels in linear light."""
    pictures, decoder = unsplash(slice(3, 6)), _wiener(AUTHORS)
    designed = PupilPattern("designed", design(AUTHORS))
    table = _evaluate([designed], pictures, AUTHORS, decoder)
    linear, coded = (
        table.find("designed", decoder.name, scale).scores for scale in ("linear", "srgb")
    )
    return Figure(
        "published simulation's protocol, blind Wiener, ten distances, linear light",
        f"≥ {_AUTHORS_GOAL:g} dB",
        f"{linear.on_grid:.2f} dB, off the grid {linear.off_grid:.2f} dB; in sRGB "
        f"{coded.on_grid:.2f} dB; {len(pictures)} photographs",
        linear.on_grid >= _AUTHORS_GOAL,
    )


@cache
def design(protocol: EdofProtocol) -> torch.Tensor:
    """The pattern for one filter, on pixels of the protocol, from rings; no picture is used.

    Pixels of full resolution have the packaged spectrum of photographs, and binned ones that of
    the photographs for training, resized as the protocol says.
    """
    optics = TransferDesign(
        CAMERA, _WAVELENGTH, _SIZE // protocol.binning // 2 * 2, protocol.binning
    )
    transfer = QuarterTransfer(optics)
    if protocol.binning == 1:
        spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    else:
        trained = measure_training_spectrum(unsplash(slice(3)), protocol)(optics.size)
        spectrum = transfer.grid.select_quarter(trained)
    found = design_pattern(
        transfer,
        crop_quarter(_rings()),
        spectrum,
        _NOISE,
        steps=_STEPS,
        generator=torch.Generator().manual_seed(_SEED),
    )
    return transfer.mirror(found.phase)


def hand_made() -> list[PupilPattern]:
    """Patterns from the literature, for objects from half a metre to infinity."""
    panel = CAMERA.panel
    y, x = panel.plane.mesh()
    # Cubic masks are in focus in the middle of the range, but for the published one.
    middle = math.pi / _WAVELENGTH * (y**2 + x**2)
    corner = math.hypot(*panel.shape) * panel.pitch / 2
    phases = {
        "cubic, 1 wave": cubic_phase_mask(panel, 2 * math.pi),
        **{
            f"cubic {waves:g} waves": cubic_phase_mask(panel, 2 * math.pi * waves) - middle
            for waves in _CUBICS
        },
        "log asphere": logarithmic_asphere(panel, 0.5, 50.0, math.inf, _WAVELENGTH, corner),
        "rings": _rings(),
        "sweep": focal_sweep_axicon(panel, 2.15, 0.0, _WAVELENGTH),
    }
    return [PupilPattern(name, phase) for name, phase in phases.items()]


def _rings() -> torch.Tensor:
    """Rings of ten foci."""
    return multi_focus_rings(CAMERA.panel, even_vergences(2.0, 0.0, 10), _WAVELENGTH)


@cache
def _wiener(protocol: EdofProtocol) -> BlindDecoder:
    """One filter for all depths, for the spectrum of photographs that nothing is judged on."""
    pictures = unsplash(slice(3))
    if protocol.shortest_edge is None:
        pictures = [
            read_photograph(path) for path in sorted((DATA / "bsds500_train").glob("*.jpg"))
        ]
    return blind_wiener(measure_training_spectrum(pictures, protocol))


def _evaluate(
    patterns: Sequence[PupilPattern],
    pictures: Sequence[torch.Tensor],
    protocol: EdofProtocol,
    decoder: BlindDecoder,
) -> EvaluationTable:
    return evaluate_patterns(patterns, pictures, CAMERA, protocol, [decoder], with_ssim=False)


def _row(table: EvaluationTable, pattern: str) -> ScoreRow:
    return table.find(pattern, "blind Wiener")


def unsplash(some: slice) -> list[torch.Tensor]:
    return [read_photograph(path) for path in sorted((DATA / "unsplash").glob("*.jpg"))[some]]


def read_photograph(path: Path) -> torch.Tensor:
    """sRGB values of a photograph: red, green, blue, uint8."""
    stored = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert stored is not None
    return torch.from_numpy(np.ascontiguousarray(stored[..., ::-1]))


MEASUREMENTS = {"edof-protocol": edof_protocol_figures}
