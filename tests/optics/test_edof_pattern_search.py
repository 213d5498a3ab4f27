"""The search for patterns: it improves, resumes bit by bit, and survives bad gradients."""

import copy
import itertools
import math

import pytest
import torch
from sweeps import some

from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.dioptres import random_dioptres
from optics.edof.panel_transfer import FullTransfer, QuarterTransfer
from optics.edof.pattern_rating import SearchSettings, SearchState, rate_pattern
from optics.edof.pattern_search import MOST_FAILURES, DesignBand, design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM
from optics.edof.transfer_design import TransferDesign
from optics.progress import Cancelled, Progress

PANEL = Panel(shape=(24, 32), pitch=60e-6, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
DESIGN = TransferDesign(CAMERA, 520e-9, 32, reach=40)
RANGE = (0.0, 30.0)
SETTINGS = SearchSettings(parts=8, warm_up=3)


def _search(transfer, steps, criterion="blind", seed=1, **given):
    given.setdefault("start", torch.zeros(transfer.shape))
    given.setdefault("settings", SETTINGS)
    return design_pattern(
        transfer,
        spectrum=NATURAL_SPECTRUM.on_grid(transfer.grid),
        noise=0.01,
        steps=steps,
        generator=torch.Generator().manual_seed(seed),
        criterion=criterion,
        depth_range=RANGE,
        **given,
    )


@pytest.mark.parametrize(
    ("criterion", "kind"),
    some(itertools.product(["blind", "known"], [QuarterTransfer, FullTransfer]), 1, 2),
)
def test_search_finds_a_better_pattern(kind, criterion):
    transfer = kind(DESIGN)
    found = _search(transfer, 60, criterion)
    name = "blind" if criterion == "blind" else "known_depth"
    gain = getattr(found.rating, name) - getattr(found.start_rating, name)
    assert gain > 0.4
    assert found.phase.shape == transfer.shape
    assert [step for step, _ in found.history] == [10, 20, 30, 40, 50, 60]
    # The gain isn't one of the rated depths alone.
    others = random_dioptres(40, torch.Generator().manual_seed(9), RANGE)
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    elsewhere = rate_pattern(transfer, found.phase, spectrum, 0.01, others)
    assert getattr(elsewhere, name) - getattr(found.start_rating, name) > 0.8 * gain
    assert found.history[-1][1] == pytest.approx(getattr(found.rating, name), abs=1.0)


@pytest.mark.parametrize("criterion", some(["blind", "known"]))
def test_resumed_search_is_the_same_bit_by_bit(criterion):
    transfer = QuarterTransfer(DESIGN)
    whole = _search(transfer, 14, criterion)
    state = SearchState()
    with pytest.raises(Cancelled):
        _search(transfer, 14, criterion, state=state, progress=_cancelled_at(0.7))
    assert state.step == 10
    kept = copy.deepcopy(state)
    resumed = _search(transfer, 14, criterion, seed=999, state=kept)
    assert torch.equal(resumed.phase, whole.phase)
    assert resumed.history == whole.history


def _cancelled_at(share):
    progress = Progress(lambda fraction, _: progress.cancel() if fraction > share else None)
    return progress


def test_two_runs_of_one_seed_are_identical():
    transfer = QuarterTransfer(DESIGN)
    first, second = (_search(transfer, 5).phase for _ in range(2))
    assert torch.equal(first, second)
    assert not torch.equal(first, _search(transfer, 5, seed=2).phase)


def test_parameters_may_be_fewer_than_pixels():
    transfer = QuarterTransfer(DESIGN)
    y = torch.linspace(0, 1, 12, dtype=torch.float64)[:, None]
    x = torch.linspace(0, 1, 16, dtype=torch.float64)[None, :]

    def pattern(parameters):
        return parameters[0] * (y**2 + x**2) + parameters[1] * (y**4 + x**4)

    found = _search(transfer, 30, start=torch.zeros(2), pattern=pattern)
    assert found.parameters.shape == (2,)
    assert found.rating.blind > found.start_rating.blind
    assert torch.allclose(found.phase, pattern(found.parameters))


def test_steps_without_a_finite_gradient_are_skipped():
    transfer, calls = QuarterTransfer(DESIGN), []

    def pattern(parameters):
        calls.append(parameters.requires_grad and torch.is_grad_enabled())
        broken = sum(calls) in (3, 4) and calls[-1]
        return parameters * (math.nan if broken else 1.0)

    found = _search(transfer, 12, pattern=pattern)
    assert found.skipped == 2
    assert bool(torch.isfinite(found.phase).all())
    assert found.rating.blind > found.start_rating.blind


def test_search_stops_after_many_bad_gradients():
    transfer, calls = QuarterTransfer(DESIGN), []

    def pattern(parameters):
        calls.append(torch.is_grad_enabled())
        return parameters * (math.nan if calls[-1] and sum(calls) > 2 else 1.0)

    state = SearchState()
    with pytest.raises(FloatingPointError, match="no finite gradient"):
        _search(transfer, 50, pattern=pattern, state=state)
    assert state.skipped == MOST_FAILURES
    assert bool(torch.isfinite(state.parameters).all())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 0}, "steps"),
        ({"criterion": "both"}, "criterion"),
        ({"start": torch.zeros(3, 3)}, "phase is"),
    ],
)
def test_bad_arguments_are_named(change, message):
    given = {"steps": 2} | change
    with pytest.raises(ValueError, match=message):
        _search(QuarterTransfer(DESIGN), **given)


def test_bad_settings_are_named():
    for change in ({"rate": 0.0}, {"depths": 0}, {"depths": 9, "parts": 8}):
        with pytest.raises(ValueError, match=next(iter(change))):
            SearchSettings(**change)


@pytest.mark.parametrize("criterion", some(["blind", "known"]))
def test_a_pattern_for_two_wavelengths_gains_at_both(criterion):
    """At twice the phase, the search for the first alone gains less there."""
    transfer = QuarterTransfer(DESIGN)
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    name = "blind" if criterion == "blind" else "known_depth"
    start = 3 * torch.rand(transfer.shape, generator=torch.Generator().manual_seed(3))
    other = DesignBand(transfer, spectrum, lambda phase: 2 * phase)
    both = _search(transfer, 120, criterion, start=start, further_bands=[other])
    alone = _search(transfer, 60, criterion, start=start)

    def level(phase):
        dioptres = random_dioptres(32, torch.Generator().manual_seed(4), RANGE)
        return getattr(rate_pattern(transfer, phase, spectrum, 0.01, dioptres), name)

    assert level(both.phase) > level(start) + 0.2
    assert level(2 * both.phase) > level(2 * start) + 0.2
    assert level(2 * both.phase) > level(2 * alone.phase) + 0.1
    assert getattr(both.further_ratings[0], name) == pytest.approx(level(2 * both.phase), abs=0.2)


def test_a_search_for_two_wavelengths_goes_on_bit_by_bit():
    transfer = QuarterTransfer(DESIGN)
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    bands = [DesignBand(transfer, spectrum, lambda phase: 2 * phase)]
    whole = _search(transfer, 14, further_bands=bands)
    state = SearchState()
    with pytest.raises(Cancelled):
        _search(transfer, 14, further_bands=bands, state=state, progress=_cancelled_at(0.7))
    resumed = _search(transfer, 14, seed=9, further_bands=bands, state=copy.deepcopy(state))
    assert torch.equal(resumed.phase, whole.phase)
