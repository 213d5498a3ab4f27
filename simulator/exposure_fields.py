"""What leaves the panel during an exposure: pictures that stand, or a video on its way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
import torch
from numpy.typing import NDArray

from optics.slm import Modulator
from optics.slm.dynamics import first_start_phase, relaxed_phase
from simulator.panel_content import FrameSequence, PictureShares, Span

Pictures = Mapping[str, NDArray[np.uint8]]
WeightedFields = Iterator[tuple[float, torch.Tensor]]
"""Shares of an exposure and fields on the panel's pixels, whose PSFs add up to the mean."""

_MEMORY_TIME_CONSTANTS = 36.0
"""Time constants after which nothing of a frame is left, in double precision."""


def exposure_fields(
    modulator: Modulator, panel_state: PictureShares | FrameSequence, pictures: Pictures, tol: float
) -> WeightedFields:
    """Of what an exposure sees; nothing is made before it is asked for.

    tol: of averages over time.
    """
    if isinstance(panel_state, FrameSequence):
        yield from _moving(modulator, panel_state, pictures, tol)
        return
    for name, share in panel_state.shares:
        if share > 0:
            phase = _settled_phase(modulator, pictures, name)
            fields = modulator.flicker_fields(phase, dtype=torch.float32, tol=tol)
            yield from ((share * weight, field) for weight, field in fields)


def _settled_phase(modulator: Modulator, pictures: Pictures, name: str) -> torch.Tensor:
    return torch.as_tensor(modulator.phase(torch.from_numpy(pictures[name].copy())))


def _moving(
    modulator: Modulator, seen: FrameSequence, pictures: Pictures, tol: float
) -> WeightedFields:
    """Of a video that has been repeated for ever, and whose liquid crystal follows.

    Part of a frame is a shorter frame, that begins with the phase which is reached by then.
    """
    tau, frame_time = modulator.panel.response_time, seen.frame_time
    # Whatever was shown long before the first frame is forgotten.
    recent = seen.names[-max(1, math.ceil(_MEMORY_TIME_CONSTANTS * tau / frame_time)) :]
    before = torch.stack([_settled_phase(modulator, pictures, name) for name in recent])
    start = first_start_phase(before, frame_time, tau)
    spans: dict[int, list[Span]] = {}
    for span in seen.spans:
        spans.setdefault(span.frame, []).append(span)
    for frame, name in enumerate(seen.names):
        end = _settled_phase(modulator, pictures, name)
        for span in spans.get(frame, ()):
            begun, seconds = relaxed_phase(end, start, span.begin, tau), span.end - span.begin
            fields = modulator.transition_fields(begun, end, seconds, dtype=torch.float32, tol=tol)
            yield from ((span.share * share, field) for share, field in fields)
        start = relaxed_phase(end, start, frame_time, tau)
