"""What the stages of `labapp train edof` lower: decoded pictures, losses and their gradients.

Expected values are computed by hand with numpy, or are finite differences.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tiny_edof
import torch
from skimage.metrics import structural_similarity

from labapp.edof.design_problem import EdofProblem
from labapp.training.command import count_steps
from labapp.training.edof import decoder_task, joint_task, optics_table
from labapp.training.edof.captures import Captures, capture_scenes
from labapp.training.edof.decoder_task import decode_captures, scene_losses
from labapp.training.edof.joint_task import JointTask
from labapp.training.processes import Processes
from optics.edof.learned import DecoderNetwork, WienerFront
from optics.edof.panel_transfer import ConditionTransfer, QuarterTransfer
from optics.edof.spectral_criterion import blind_filter

# What is decoded, and its loss.


@pytest.mark.parametrize("front", ["blind", "known", "none"])
def test_decoders_get_what_their_settings_say(front):
    """A network that is zero gives back the filtered picture, or the capture."""
    changes = {"decoder": {"front": front, "psf_channel": front == "known", "fold": 1}}
    config = tiny_edof.make_config(changes)
    network = DecoderNetwork(config.decoder.settings("srgb"))
    channels = []
    network.refining.register_forward_pre_hook(lambda module, given: channels.append(given[0]))
    drawn = [tiny_edof.plane(1), tiny_edof.plane(2, 3)]
    transfers = [tiny_edof.random_transfers(len(one.depths), k) for k, one in enumerate(drawn)]
    spectrum = torch.rand(16, 9, generator=torch.Generator().manual_seed(0))
    captures = capture_scenes(drawn, transfers, linear=False)
    known = WienerFront.of_transfers(torch.cat(transfers), spectrum)
    found = decode_captures(network, captures, known, transfers)
    for k in range(2):
        own = {"blind": torch.cat(transfers), "known": transfers[k][-1:], "none": None}[front]
        wanted = captures.pictures[k, 0]
        if own is not None:
            response = blind_filter(own, spectrum, 0.03).numpy()
            wanted = np.fft.irfft2(np.fft.rfft2(wanted.numpy()) * response)
        np.testing.assert_allclose(found[k, 0].detach(), wanted, atol=2e-4)
        if front == "known":
            psf = np.fft.fftshift(np.fft.irfft2(transfers[k][-1].numpy()))
            np.testing.assert_allclose(channels[0][k, 3], psf / psf.max(), atol=1e-4)


def test_losses_by_hand():
    rng = np.random.default_rng(3)
    truth = rng.random((3, 24, 24), dtype=np.float32)
    found = truth + rng.normal(0, 0.1, truth.shape).astype(np.float32)
    found[2] = truth[2]
    captures = Captures(torch.zeros(3, 1, 24, 24), torch.from_numpy(truth)[:, None], torch.ones(3))
    decoded = torch.from_numpy(found)[:, None], captures
    errors = ((found - truth) ** 2).mean((1, 2))
    alike = [
        structural_similarity(
            a, b, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
        )
        for a, b in zip(found, truth, strict=True)
    ]
    cases = [
        ({"loss": "squared"}, errors),
        ({"loss": "level"}, np.log(errors + 1e-5)),
        ({"structure_weight": 0.5}, np.log(errors + 1e-5) + 0.5 * (1 - np.array(alike))),
    ]
    for change, wanted in cases:
        config = tiny_edof.make_config({"training": change})
        np.testing.assert_allclose(scene_losses(decoded, config), wanted, rtol=1e-3, atol=1e-5)


def test_validation_is_the_mean_psnr_of_scenes_that_no_step_has(monkeypatch):
    config = tiny_edof.make_config({"training": {"validation_scenes": 6}})
    task, drawn = tiny_edof.make_decoder_task(config), []
    draw = task._sampler.draw

    def note(step, samples, split="training"):
        drawn.append((step, list(samples), split))
        return draw(step, samples, split)

    monkeypatch.setattr(task._sampler, "draw", note)
    found = task.validate()
    assert drawn == [(2**32 - 1, [0, 1, 2, 3], "validation"), (2**32 - 1, [4, 5], "validation")]
    with torch.no_grad():
        pictures, captures = task._decode(draw(2**32 - 1, range(6), "validation"))
    errors = ((pictures - captures.truth) ** 2).mean((1, 2, 3)).numpy()
    assert found == pytest.approx(np.mean(-10 * np.log10(errors)), abs=1e-4)
    assert task.validate() == found


def test_validation_of_a_joint_training_is_of_the_pattern_as_it_is_and_changes_nothing():
    """What is remembered is of the patterns of earlier steps; validation sees none of it."""
    task, config = tiny_edof.make_joint_task(tiny_edof.make_config()), tiny_edof.make_config()
    before = task.extra_state()["remembered"].clone()
    with torch.no_grad():
        task.module.pattern.add_(torch.rand_like(task.module.pattern))
        found = task.validate()
        assert torch.equal(task.extra_state()["remembered"], before)
        problem = tiny_edof.make_problem(config)
        other = JointTask(task.module, problem, task._sampler, config, Processes(), {})
        assert other.validate() == found
        assert not torch.equal(other.extra_state()["remembered"], before)


# Gradients.


def in_double(monkeypatch) -> None:
    """Compute transfer functions in double precision, and so all that follows from them."""

    def transfer(self, wavelength, **given):
        return QuarterTransfer(make(self, wavelength, **given).design, torch.complex128)

    def on_axis(transfer, phase, dioptres, condition=None):
        seen = transfer if condition is None else ConditionTransfer(transfer, condition)
        return transfer.on_axis(seen(phase, tuple(dioptres)), dioptres)

    make = EdofProblem.transfer

    def losses(decoded, config):
        pictures, captures = decoded
        return scene_losses((pictures, replace(captures, truth=captures.truth.double())), config)

    monkeypatch.setattr(joint_task, "scene_losses", losses)
    monkeypatch.setattr(EdofProblem, "transfer", transfer)
    for module in (joint_task, optics_table):
        monkeypatch.setattr(module, "transfer_on_axis", on_axis)


STRUCTURE = {"training": {"structure_weight": 0.5}}
SQUARED = {"training": {"loss": "squared"}, "scenes": {"light": "linear"}}
KNOWN = {"decoder": {"front": "known", "psf_channel": True}}
FRINGING = {"pattern": {"fringing_um": 30.0}}


@pytest.mark.parametrize(
    "changes",
    [
        STRUCTURE | FRINGING,
        SQUARED | KNOWN,
        *(
            pytest.param(one, marks=pytest.mark.sweep)
            for one in (STRUCTURE, SQUARED, KNOWN, FRINGING)
        ),
    ],
)
def test_gradients_of_a_joint_step_are_those_of_finite_differences(monkeypatch, changes):
    """With a filter of all depths, and memory, held at what they are at the step's weights.

    The filter is nearly the best for the pattern, so that a step leaves its derivative out.
    """
    in_double(monkeypatch)
    task = tiny_edof.make_joint_task(tiny_edof.make_config(changes))
    module = task.module
    module.network.double()
    kept = joint_task.DepthStatistics.of_transfers
    once = []

    def hold(*given):
        once.append(once[0] if once else kept(*given))
        return once[0]

    monkeypatch.setattr(joint_task.DepthStatistics, "of_transfers", hold)
    loss = task.losses(1, range(3)).sum()
    gradients = torch.autograd.grad(loss, list(module.parameters()))
    monkeypatch.setattr(task, "_remember", lambda places, fresh: None)

    @torch.no_grad()
    def loss_at(parameter: torch.Tensor, change: torch.Tensor) -> float:
        before = parameter.clone()
        parameter.add_(change)
        found = float(task.losses(1, range(3)).sum())
        parameter.copy_(before)
        return found

    generator = torch.Generator().manual_seed(0)
    for (name, parameter), gradient in zip(module.named_parameters(), gradients, strict=True):
        if not gradient.any():
            continue
        directions = [torch.zeros_like(parameter) for _ in range(2)]
        directions[0][gradient.abs() == gradient.abs().max()] = 1
        directions[1].copy_(torch.randn(parameter.shape, generator=generator))
        for direction in directions:
            step = 1e-5 * direction
            measured = (loss_at(parameter, step) - loss_at(parameter, -step)) / 2e-5
            size = float(gradient.norm() * direction.norm())
            assert float((gradient * direction).sum()) == pytest.approx(
                measured, rel=1e-3, abs=1e-5 * size
            ), name
    assert module.pattern.grad is None
    assert gradients[0].any()


def test_counting_steps_leaves_both_stages_as_they_were():
    config = tiny_edof.make_config()
    for make, schedule in (
        (tiny_edof.make_decoder_task, decoder_task.decoder_schedule),
        (tiny_edof.make_joint_task, joint_task.joint_schedule),
    ):
        task, other = make(config), make(config)
        assert count_steps(task, schedule(config, 1000), 0.001, Processes()) >= 1
        assert torch.equal(task.losses(3, range(3)), other.losses(3, range(3)))
