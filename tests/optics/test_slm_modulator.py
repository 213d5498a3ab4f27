import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import j0
from sweeps import some

from optics.slm import Modulator, Panel, PanelMap, PhaseResponse, modulator
from optics.slm.modulator import front_reflection_share, transmitted_unmodulated_share

WAVELENGTH = 550e-9
PANEL = Panel((6, 8))
FRAME = 1 / 60


def phases(*shape, waves=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.uniform(0, 2 * np.pi * waves, (*shape, *PANEL.shape)))


def made(**effects):
    return Modulator(replace(PANEL, **effects), WAVELENGTH)


def beam():
    """A Gaussian beam that is off the panel's centre."""
    y, x = np.mgrid[:6, :8]
    return PanelMap(3.0 * np.exp(-((y - 1) ** 2 + (x - 5) ** 2) / 20))


def bowl():
    y, x = np.mgrid[:6, :8]
    return PanelMap(4e-7 * ((y - 3) ** 2 + (x - 4) ** 2) / 25)


# One at a time


def test_a_plain_panel_turns_the_phase_and_nothing_else():
    phase = phases(2)
    assert torch.allclose(made().modulation(phase), torch.exp(1j * phase), atol=1e-15)


def test_effects_that_are_off_are_not_called(monkeypatch):
    """Whatever an effect is computed by, it raises if it is called."""

    def called(*args, **kwargs):
        raise AssertionError("an effect is off, and was computed")

    names = "fringing_field_mean gap_amplitude flatness_phase flicker_nodes scattered_share"
    for name in (names + " first_start_phase time_node_count relaxed_phase time_nodes").split():
        monkeypatch.setattr(modulator, name, called)
    plain = made(unmodulated=0.0)
    grey = plain.grey(phases())
    assert len(plain.still_fields(grey)) == 1
    assert len(list(plain.video_cycle_fields(phases(3), FRAME))) == 3
    assert plain.jitter_scatter_share == plain.unmodulated_share == 0
    assert plain.unmodulated_fields == []


def test_the_illumination_has_a_mean_of_one_and_its_root_is_the_amplitude():
    light = beam()
    field = made(illumination=light).modulation(phases())
    assert torch.allclose(field.abs() ** 2, light.values / light.values.mean(), rtol=1e-12)
    assert torch.allclose(field.angle(), torch.exp(1j * phases()).angle(), atol=1e-12)


def test_the_flatness_is_a_path():
    """2 pi path / wavelength, beside the pattern, whatever the wavelength."""
    for wavelength in (480e-9, 620e-9):
        field = Modulator(replace(PANEL, flatness=bowl()), wavelength).modulation(phases())
        wanted = torch.exp(1j * (phases() + 2 * np.pi * bowl().values / wavelength))
        assert torch.allclose(field, wanted, atol=1e-12)


def test_the_gaps_light_is_that_of_its_area():
    """A panel cut into 20 x 20 parts a pixel: the sum of all fields, on the axis."""
    panel = replace(PANEL, fill_factor=0.81, gap_reflection=0.3)
    active = np.zeros((20, 20), dtype=bool)
    active[1:19, 1:19] = True
    parts = np.where(
        np.tile(active, PANEL.shape), np.exp(1j * np.kron(phases().numpy(), np.ones((20, 20)))), 0.3
    )
    field = Modulator(panel, WAVELENGTH).modulation(phases())
    assert complex(field.sum()) * active.sum() == pytest.approx(parts.sum(), rel=1e-12)


@pytest.mark.parametrize("turn", [0.1, 0.25])
def test_off_the_axis_the_gaps_light_is_wrong_by_what_is_said(turn):
    """A share `turn` of the way to the first order, where every pixel's field has turned by
    2 pi `turn`; the neutral panel's parts are summed with their own phases."""
    panel = Panel((1, 1), fill_factor=0.81, gap_reflection=0.3)
    n = 2000
    x = (np.arange(n) + 0.5) / n - 0.5
    inside = np.abs(x) < 0.45
    kernel = np.exp(-2j * np.pi * turn * x)
    line = 0.3 * kernel.mean() + 0.7 * 0.9 * (kernel * inside).mean()
    field = Modulator(panel, WAVELENGTH).modulation(torch.zeros(1, 1).double())
    said = 0.3 * (np.sinc(turn) - np.sinc(0.9 * turn)) / 0.81
    assert complex(field) * np.sinc(0.9 * turn) == pytest.approx(line / 0.81 - said, abs=1e-3)


def test_coupling_reaches_the_light_in_pixels():
    """2 µm on pixels of 8 µm, of which 0.81 are active: a step beside a pixel."""
    panel = Panel((3, 12), fill_factor=0.81, coupling=2e-6)
    phase = torch.zeros(3, 12, dtype=torch.float64)
    phase[:, 6:] = 3.0
    field = Modulator(panel, WAVELENGTH).modulation(phase)
    x = (np.arange(4000) + 0.5) / 4000 * 7.2e-6 - 3.6e-6
    ramp = [3.0 * 0.5 * (1 + math.erf((p - 4e-6) / (2e-6 * math.sqrt(2)))) for p in x]
    assert abs(complex(field[1, 5]) - np.exp(1j * np.array(ramp)).mean()) <= 3e-3


def test_light_that_is_not_modulated_is_what_wasnt_turned_and_what_the_glass_reflects():
    """0.5 % of the light that falls in are 0.5 / 60 of what comes out."""
    both = made(front_reflection=0.005, unmodulated=0.06)
    assert both.unmodulated_share == pytest.approx(0.005 / 0.6 + (1 - 0.005 / 0.6) * 0.06)
    assert (
        front_reflection_share(both.panel) + transmitted_unmodulated_share(both.panel)
        == both.unmodulated_share
    )
    ((share, field),) = both.unmodulated_fields
    assert (share, field) == (both.unmodulated_share, None)


def test_the_glass_does_not_have_the_panels_flatness():
    both = made(front_reflection=0.005, flatness=bowl(), illumination=beam())
    (glass, flat), (through, bent) = both.unmodulated_fields
    assert (glass, through) == (
        front_reflection_share(both.panel),
        transmitted_unmodulated_share(both.panel),
    )
    assert not flat.is_complex()
    assert torch.allclose(bent, flat * torch.exp(2j * np.pi * bowl().values / WAVELENGTH))


def test_jitter_scatters_what_ruze_says():
    assert made(jitter=0.3).jitter_scatter_share == pytest.approx(1 - math.exp(-0.09), rel=1e-12)
    assert made(jitter=1e-9).jitter_scatter_share == pytest.approx(1e-18, rel=1e-12)


# Together, and in time


def test_a_flickering_picture_fades_by_bessels_function():
    """Mean field of an even panel: J0(flicker phase) of its own."""
    flickering = made(flicker=0.05)
    grey = torch.full(PANEL.shape, 200, dtype=torch.uint8)
    phase = float(flickering.phase(grey)[0, 0])
    nodes = flickering.still_fields(grey, dtype=torch.float64)
    mean = sum(share * complex(field[0, 0]) for share, field in nodes)
    assert abs(mean - np.exp(1j * phase) * j0(0.05 * phase)) <= 1e-2
    assert sum(share for share, _ in nodes) == pytest.approx(1)


@pytest.mark.parametrize(
    ("flicker", "tau"), some(itertools.product([0.0, 0.02], [0.0, 2e-3, 8e-3, 50e-3]), 1, 3, 4, 6)
)
def test_a_videos_light_is_the_mean_over_time(tau, flicker):
    """Brute force: 100 moments a frame, 16 of the ripple each, after many cycles from rest."""
    video = phases(3)
    slow = made(response_time=tau, flicker=flicker, coupling=1e-6)
    ripple = 1 + flicker * torch.sin(2 * math.pi * (torch.arange(16) + 0.5) / 16)
    time = (torch.arange(100) + 0.5) / 100 * FRAME
    left = (torch.exp(-time / tau) if tau else torch.zeros(1))[:, None, None, None]
    state = torch.zeros(PANEL.shape, dtype=torch.float64)
    known = torch.zeros(PANEL.shape, dtype=torch.float64)
    cycles = math.ceil(20 * tau / (3 * FRAME)) + 1
    for frame in range(3 * cycles):
        end = video[frame % 3]
        if frame >= 3 * (cycles - 1):
            moments = (end + (state - end) * left) * ripple[:, None, None]
            known += far_light(slow.modulation(moments)).mean((0, 1)) / 3
        state = end + (state - end) * (math.exp(-FRAME / tau) if tau else 0.0)
    found = sum(
        share * far_light(field) for _, share, field in slow.video_cycle_fields(video, FRAME)
    )
    assert float((found - known).norm() / known.norm()) <= 1e-3


def far_light(field):
    return torch.fft.fft2(field).abs() ** 2


def test_each_frame_has_its_share_of_a_cycle():
    parts = list(made(response_time=4e-3, flicker=0.01).video_cycle_fields(phases(5), FRAME))
    shares = [0.0] * 5
    for frame, share, _ in parts:
        shares[frame] += share
    assert shares == pytest.approx([0.2] * 5)
    assert [frame for frame, _, _ in parts] == sorted(frame for frame, _, _ in parts)


def test_one_frame_for_ever_is_a_still():
    video = phases(1)
    fields = [field for _, _, field in made(response_time=5e-3).video_cycle_fields(video, FRAME)]
    assert len(fields) == 1
    assert torch.allclose(fields[0], torch.exp(1j * video[0]))


def test_everything_at_once_is_bounded_and_finite():
    everything = made(
        response=PhaseResponse.from_curve(WAVELENGTH, torch.linspace(0, 1.1, 256) ** 1.2),
        response_time=5e-3,
        coupling=1.5e-6,
        flicker=0.01,
        jitter=0.1,
        front_reflection=0.005,
        gap_reflection=0.3,
        flatness=bowl(),
        illumination=beam(),
    )
    most = float(torch.sqrt(beam().values.max() / beam().values.mean())) * (1 + 0.3 * 0.13 / 0.87)
    grey = everything.grey(phases(), orders=2)
    for _, field in everything.still_fields(grey):
        assert field.dtype == torch.complex64
        assert torch.isfinite(torch.view_as_real(field)).all()
        assert float(field.abs().max()) <= most * (1 + 1e-5)


def test_no_pixel_of_a_plain_beam_becomes_brighter():
    field = made(coupling=2e-6, flatness=bowl()).modulation(phases(waves=3))
    assert float(field.abs().max()) <= 1 + 1e-12


# Gradients, arrays, bad input


@pytest.mark.parametrize(
    "effects",
    [{}, {"coupling": 2e-6}, {"gap_reflection": 0.3}, {"flatness": bowl(), "illumination": beam()}],
)
def test_the_field_is_differentiable(effects):
    phase = phases()[:2, :3].clone().requires_grad_()
    panel = replace(PANEL, shape=(2, 3), **effects)
    assert torch.autograd.gradcheck(Modulator(panel, WAVELENGTH).modulation, phase)


def test_a_videos_mean_light_is_differentiable_in_its_frames():
    """Also in the frames before, which the crystal remembers."""
    video = phases(3)[:, :2, :2].clone().requires_grad_()
    panel = replace(PANEL, shape=(2, 2), response_time=8e-3, flicker=0.01)

    def light(video):
        cycle = Modulator(panel, WAVELENGTH).video_cycle_fields(video, FRAME)
        return sum(share * far_light(field)[0, 0] for _, share, field in cycle)

    assert torch.autograd.gradcheck(light, video)


def test_at_a_phase_of_zero_gradients_are_finite():
    everything = made(coupling=1e-6, gap_reflection=0.2, response_time=5e-3, flicker=0.01)
    video = torch.zeros(2, *PANEL.shape, dtype=torch.float64, requires_grad=True)
    sum(
        s * far_light(f).sum() for _, s, f in everything.video_cycle_fields(video, FRAME)
    ).backward()
    assert torch.isfinite(video.grad).all()


def test_arrays_come_in_and_go_out():
    one = made(coupling=1e-6)
    grey = one.grey(phases().numpy())
    assert isinstance(grey, np.ndarray)
    field = one.modulation(one.phase(grey))
    assert isinstance(field, np.ndarray)
    assert field.dtype == np.complex128
    ((_, kept),) = one.still_fields(grey)
    assert np.allclose(kept.numpy(), field, atol=1e-5)


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"gap_reflection": 0.3, "flatness": bowl(), "illumination": beam()},
        {"coupling": 2e-6},
        {"response": PhaseResponse((WAVELENGTH,), torch.linspace(0, 1, 512).reshape(1, 1, 2, 256))},
    ],
    ids=["plain", "gap and maps", "coupled", "two regions"],
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_field_of_grey_levels_is_that_of_their_phase(effects, dtype):
    one = made(**effects)
    grey = torch.from_numpy(np.random.default_rng(1).integers(0, 256, (3, *PANEL.shape), np.uint8))
    wanted = one.modulation(one.phase(grey).to(dtype))
    found = one.modulation_of_grey(grey, dtype=dtype)
    assert found.dtype == wanted.dtype
    assert torch.equal(found, wanted)


@pytest.mark.parametrize(
    ("grey", "told"),
    [
        (torch.full((6, 8), 300), "grey goes from 300 to 300; the panel's levels are 0 to 255"),
        (torch.zeros(6, 7, dtype=torch.uint8), r"grey is \(6, 7\); the panel has \(6, 8\)"),
        (torch.zeros(6, 8), "grey is torch.float32; give whole levels"),
    ],
    ids=["level", "shape", "type"],
)
def test_grey_levels_that_a_panel_cannot_show_are_refused(grey, told):
    with pytest.raises(ValueError, match=told):
        made().modulation_of_grey(grey)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_precision_is_that_of_the_phase(dtype):
    everything = made(coupling=1e-6, gap_reflection=0.2, flatness=bowl(), illumination=beam())
    field = everything.modulation(phases().to(dtype))
    assert field.dtype == torch.promote_types(dtype, torch.complex32)
    assert torch.allclose(field.to(torch.complex128), everything.modulation(phases()), atol=1e-5)


@pytest.mark.parametrize(
    ("phase", "words"),
    [
        (torch.zeros(8, 6), r"phase is \(8, 6\); the panel has \(6, 8\)"),
        (torch.full((6, 8), math.nan), "phase has 48 NaN"),
        (torch.zeros(6, 8, dtype=torch.complex64), "phase is torch.complex64; give radians"),
        (torch.zeros(6, 8, dtype=torch.uint8), "phase is torch.uint8; give radians"),
    ],
)
def test_what_is_no_phase_of_the_panel_is_refused(phase, words):
    with pytest.raises(ValueError, match=words):
        made().modulation(phase)


def test_a_video_without_frames_is_refused():
    with pytest.raises(ValueError, match="phases has no frame"):
        list(made(response_time=1e-3).video_cycle_fields(phases(0), FRAME))
