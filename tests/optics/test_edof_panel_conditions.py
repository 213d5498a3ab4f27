"""Patterns on a panel whose pixels couple or whose response is wrong: OTFs, range, one filter."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative

from optics.camera import Camera, Lens, Panel, Sensor
from optics.edof.panel_transfer import (
    ConditionTransfer,
    FullTransfer,
    PanelCondition,
    QuarterTransfer,
    fold_into_range,
)
from optics.edof.pattern_rating import SearchState
from optics.edof.pattern_search import DesignBand, design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM
from optics.edof.transfer_design import TransferDesign
from optics.progress import Cancelled, Progress
from optics.psf import PSFOperator
from optics.slm import Modulator

WAVELENGTH = 520e-9
PANEL = Panel(shape=(24, 32), pitch=60e-6, unmodulated=0.0, fill_factor=0.9)
CAMERA = Camera(PANEL, Lens(0.1, 20.0, math.inf), Sensor(pitch=3.45e-6))
DESIGN = TransferDesign(CAMERA, WAVELENGTH, 64, 1, 110)
CONDITION = PanelCondition(0.6 * PANEL.pitch)


def jumping_phase(shape, seed=0) -> torch.Tensor:
    """A ramp and noise, wrapped to a wave."""
    rows, columns = (torch.arange(n, dtype=torch.float64) for n in shape)
    noise = torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.remainder(0.9 * rows[:, None] + 0.6 * columns + noise, 2 * math.pi)


def operator_transfer(panel, phase, dioptre, grid):
    """The OTF, at pixels' centres, of the PSF that the engine computes for a panel."""
    field = Modulator(panel, WAVELENGTH).modulation(phase)
    pixels = CAMERA.sensor.window_plane((221, 221))
    psf = PSFOperator(CAMERA, 1 / dioptre, WAVELENGTH, pixels, integrate=False, tol=1e-4)
    light = psf(field.angle(), field.abs()).double().numpy()
    y, x = (axis.numpy() for axis in grid.frequencies())
    n = np.arange(221) - 110
    rows = np.exp(-2j * np.pi * np.outer(y.ravel(), n))
    columns = np.exp(-2j * np.pi * np.outer(n, x.ravel()))
    return rows @ light @ columns


@pytest.mark.parametrize("response", [1.0, 0.9])
def test_fringing_is_that_of_the_panel(response):
    """Against a coupled panel in the engine, at frequencies where both have light."""
    transfer = FullTransfer(replace(DESIGN, pixel_size=True))
    phase = jumping_phase(PANEL.shape)
    condition = replace(CONDITION, response=response)
    found = ConditionTransfer(transfer, condition)(phase, (1.2,))[0].numpy()
    coupled = replace(PANEL, coupling=CONDITION.coupling)
    truth = operator_transfer(coupled, response * phase, 1.2, transfer.grid)
    plain = operator_transfer(PANEL, response * phase, 1.2, transfer.grid)
    scale = found[0, 0] / truth[0, 0]
    assert relative(found, scale * truth) <= 0.04
    assert relative(found, scale * plain) >= 0.2


def test_a_quarter_couples_with_its_mirror_images():
    quarter, full = QuarterTransfer(DESIGN), FullTransfer(DESIGN)
    phase = jumping_phase(quarter.shape)
    half = ConditionTransfer(quarter, CONDITION).field(phase)
    whole = ConditionTransfer(full, CONDITION).field(quarter.mirror(phase))
    assert torch.allclose(whole[12:, 16:], half, atol=1e-6)


def test_the_gradient_is_that_of_finite_differences():
    transfer = ConditionTransfer(QuarterTransfer(DESIGN, torch.complex128), CONDITION)
    phase = jumping_phase((12, 16)).requires_grad_()
    weights = torch.rand(transfer.grid.shares().shape, dtype=torch.float64)

    def value(one):
        return (weights * transfer(one, (0.4, 1.5))).sum()

    value(phase).backward()
    direction = torch.rand(phase.shape, dtype=torch.float64) - 0.5
    # Wide steps, as the blurred field is single precision.
    step = 0.02 * direction
    with torch.no_grad():
        difference = float(value(phase + step) - value(phase - step)) / 2
    assert float((phase.grad * step).sum()) == pytest.approx(difference, rel=0.02)


def test_a_phase_is_folded_at_both_ends_of_the_range():
    phase = torch.tensor([-1.0, 0.0, 2.0, 5.0, 6.0, 11.0], dtype=torch.float64)
    found = fold_into_range(phase, 5.0)
    assert found.tolist() == pytest.approx([1.0, 0.0, 2.0, 5.0, 4.0, 1.0])
    with pytest.raises(ValueError, match="top"):
        fold_into_range(phase, 0.0)


def test_a_search_that_knows_of_fringing_loses_less_by_it():
    """With a filter for both conditions, and against a search that doesn't know."""
    transfer = QuarterTransfer(DESIGN)
    start = jumping_phase(transfer.shape)
    coupled = ConditionTransfer(transfer, CONDITION)
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)

    def fold(phase):
        return fold_into_range(phase, 6.2)

    band = DesignBand(coupled, spectrum, fold, filter_of=0)
    knowing = search(transfer, start, 120, pattern=fold, further_bands=[band])
    alone = search(transfer, start, 60, pattern=fold)
    again = search(coupled, alone.parameters, 1, pattern=fold)
    assert len(knowing.state.sums) == 1
    assert knowing.further_ratings[0].blind > again.start_rating.blind + 0.05


def test_a_search_with_one_filter_for_conditions_goes_on_bit_by_bit():
    transfer = QuarterTransfer(DESIGN)
    start = jumping_phase(transfer.shape)
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    bands = [
        DesignBand(ConditionTransfer(transfer, CONDITION), spectrum, lambda one: one, filter_of=0),
        DesignBand(transfer, spectrum, lambda one: 2 * one),
        DesignBand(ConditionTransfer(transfer, CONDITION), spectrum, torch.clone, filter_of=2),
    ]
    whole = search(transfer, start, 24, further_bands=bands)
    state, progress = SearchState(), Progress(lambda done, _: done < 0.3 or progress.cancel())
    with pytest.raises(Cancelled):
        search(transfer, start, 24, further_bands=bands, state=state, progress=progress)
    assert 0 < state.step < 24
    resumed = search(transfer, start, 24, further_bands=bands, state=state)
    assert torch.equal(resumed.phase, whole.phase)


def search(transfer, start, steps, **options):
    spectrum = NATURAL_SPECTRUM.on_grid(transfer.grid)
    generator = torch.Generator().manual_seed(5)
    return design_pattern(
        transfer, start, spectrum, 0.01, steps=steps, generator=generator,
        depth_range=(0.0, 1.0), **options,
    )  # fmt: skip


def test_bad_conditions_and_filters_are_named():
    transfer = QuarterTransfer(DESIGN)
    for change, name in (({"coupling": -1e-6}, "coupling"), ({"response": 0.0}, "response")):
        with pytest.raises(ValueError, match=name):
            PanelCondition(**change)
    with pytest.raises(ValueError, match=r"coupling is 0\.0001 m; choose at most"):
        ConditionTransfer(transfer, PanelCondition(1e-4))
    band = DesignBand(transfer, torch.ones(33, 33), torch.clone, filter_of=1)
    with pytest.raises(ValueError, match="filter_of of band 1 is 1"):
        search(transfer, torch.zeros(12, 16), 2, further_bands=[band])
    with pytest.raises(ValueError, match="field is"):
        transfer.of_field(torch.zeros(3, 3, dtype=torch.complex64), (0.5,))
