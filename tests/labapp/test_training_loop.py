"""The loop that trains everything: right by formula, and the same however it is interrupted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import tiny_training
import torch
from tiny_training import LINE, PICTURES, LineTask, PictureTask, same

from labapp.common.errors import UserError
from labapp.files.state_file import StateFile
from labapp.training import command
from labapp.training.command import count_steps, train_for_command
from labapp.training.loop import run_training
from labapp.training.processes import Processes
from labapp.training.task import VALIDATION_STEP, sample_generator
from optics.progress import Cancelled, Progress


def reference(schedule, skipped=()):
    """Averaged weight and bias of LineTask, by the formulas of Adam and of the schedule."""
    w, b = np.full(4, 0.5), np.full(1, -0.25)
    values = [w, b]
    means = [w.copy(), b.copy()]
    first, second = [np.zeros(4), np.zeros(1)], [np.zeros(4), np.zeros(1)]
    updates = 0
    for step in range(schedule.steps):
        if step in skipped:
            continue
        updates += 1
        x, y = tiny_training.points(step, range(5))
        error = x @ values[0] + values[1] - y
        gradients = [2 * (error @ x) / 5, 2 * error.mean(keepdims=True)]
        length = math.sqrt(sum(float(g @ g) for g in gradients))
        if schedule.clip is not None and length > schedule.clip:
            gradients = [g * schedule.clip / length for g in gradients]
        if step < schedule.warm_up:
            rate = schedule.first_rate * (step + 1) / (schedule.warm_up + 1)
        else:
            angle = math.pi * (step - schedule.warm_up) / (schedule.steps - schedule.warm_up)
            falling = schedule.first_rate - schedule.last_rate
            rate = schedule.last_rate + falling * (1 + math.cos(angle)) / 2
        for k, factor in enumerate((1.0, 0.1)):
            first[k] = 0.9 * first[k] + 0.1 * gradients[k]
            second[k] = 0.999 * second[k] + 0.001 * gradients[k] ** 2
            m, v = first[k] / (1 - 0.9**updates), second[k] / (1 - 0.999**updates)
            values[k] = values[k] - rate * factor * m / (np.sqrt(v) + 1e-8)
            decay = min(schedule.average_decay, updates / (updates + 10))
            means[k] = decay * means[k] + (1 - decay) * values[k]
    return means


@pytest.mark.parametrize(
    ("change", "failing"),
    [
        ({}, {}),
        ({"warm_up": 0, "clip": 0.5}, {}),
        ({"clip": 2.0}, {"broken": (0, 7, 8), "steep": (9, 29)}),
    ],
)
def test_the_loop_is_adam_with_a_running_mean(change, failing):
    schedule = replace(LINE, **change)
    result = run_training(LineTask(**failing), schedule)
    skipped = [step for steps in failing.values() for step in steps]
    weight, bias = reference(schedule, skipped)
    np.testing.assert_allclose(result.weights["weight"][0], weight, rtol=1e-6)
    np.testing.assert_allclose(result.weights["bias"], bias, rtol=1e-6)
    assert result.skipped == len(skipped)
    assert result.steps == 30
    assert result.work == (150,)
    # The score of LineTask is the sum of the weights: it was that of the averaged ones.
    assert [step for step, _ in result.history] == [12, 24, 30]
    assert result.history[-1][1] == pytest.approx(weight.sum() + bias[0], rel=1e-6)


def test_skipped_steps_are_told():
    messages = []
    run_training(LineTask(broken=(3,)), LINE, progress=Progress(lambda _, m: messages.append(m)))
    assert "skipped" not in messages[2]
    assert messages[-1].startswith("step 30/30, loss ")
    assert messages[-1].endswith("1 skipped")


def test_five_failures_in_a_row_halt():
    run_training(LineTask(broken=range(10, 14)), LINE)
    task = LineTask(broken=range(10, 99))
    with pytest.raises(FloatingPointError, match=r"steps 11 to 15 .*Lower the learning rate"):
        run_training(task, LINE)
    assert task.module.weight.isfinite().all()


def test_a_training_that_fails_is_a_users_error(tmp_path):
    task = LineTask(broken=range(99))
    with pytest.raises(UserError, match="no finite loss"):
        train_for_command(task, LINE, tmp_path / "state", Processes())


@pytest.mark.parametrize("stop", [1, 14, 15, 39])
def test_cancelled_training_ends_in_the_same_weights(tmp_path, stop):
    """Before, at and after validations, and before the last step."""
    straight = run_training(PictureTask(), PICTURES)
    progress = Progress()
    listener = Progress(lambda share, _: progress.cancel() if share * 40 >= stop - 0.5 else None)
    progress._listener = listener.report
    kept = StateFile(tmp_path / "state", "training")
    with pytest.raises(Cancelled):
        run_training(PictureTask(), PICTURES, kept, progress=progress)
    assert torch.load(kept.path)["state"]["step"] == stop + 1
    result = run_training(PictureTask(), PICTURES, kept)
    assert same(result.weights, straight.weights)
    assert result.history == straight.history
    assert result.work == (6 * (40 - stop - 1),)


def test_training_that_ends_at_once_goes_on_from_the_last_validation(tmp_path):
    """And doesn't validate a second time there."""
    task, kept = PictureTask(), StateFile(tmp_path / "state", "training")
    losses = task.losses

    def stop(step, samples):
        if step == 15:
            raise KeyboardInterrupt
        return losses(step, samples)

    task.losses = stop
    with pytest.raises(KeyboardInterrupt):
        run_training(task, PICTURES, kept)
    result = run_training(PictureTask(), PICTURES, kept)
    straight = run_training(PictureTask(), PICTURES)
    assert same(result.weights, straight.weights)
    assert result.history == straight.history


def test_minutes_become_steps_and_change_nothing(monkeypatch):
    """Three seconds a step, and six every 15 steps: 3.4 seconds a step."""
    now = [0.0]

    class SlowTask(PictureTask):
        def losses(self, step, samples):
            # The first step is slow, as first steps are; it doesn't count.
            now[0] += 3 if step else 50
            return super().losses(step, samples)

        def validate(self):
            now[0] += 6
            return super().validate()

    monkeypatch.setattr(command.time, "perf_counter", lambda: now[0])
    task = SlowTask()
    assert count_steps(task, PICTURES, 10, Processes()) == int(600 / 3.4)
    assert count_steps(task, PICTURES, 0.01, Processes()) == 1
    assert all(one.grad is None for one in task.module.parameters())
    assert same(run_training(task, PICTURES).weights, run_training(PictureTask(), PICTURES).weights)


def test_random_numbers_belong_to_seed_step_and_sample():
    numbers = {
        float(sample_generator(*one).random())
        for one in [(1, 2, 3), (1, 3, 2), (2, 1, 3), (1, 2, 0), (1, VALIDATION_STEP, 3)]
    }
    assert len(numbers) == 5
    assert sample_generator(1, 2, 3).random() in numbers


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"steps": 0}, "steps is 0"),
        ({"validation_interval": 0}, "validation_interval is 0"),
        ({"first_rate": math.nan}, "first_rate is nan"),
        ({"last_rate": 0.4}, "last_rate is 0.4; choose 0 to first_rate, 0.3"),
        ({"warm_up": -1}, "warm_up is -1"),
        ({"average_decay": 1.0}, "average_decay is 1.0"),
        ({"clip": 0.0}, "clip is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_schedules_that_can_not_be(change, said):
    with pytest.raises(ValueError, match=said):
        replace(LINE, **change)


def test_tasks_that_can_not_be_trained():
    task = PictureTask()
    task.module.half()
    with pytest.raises(ValueError, match=r"0\.weight is torch.float16; train in float32"):
        run_training(task, PICTURES)
    task = LineTask()
    task.losses = lambda step, samples: task.module.weight.sum()
    with pytest.raises(ValueError, match="one for each of 5"):
        run_training(task, LINE)
