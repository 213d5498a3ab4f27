"""Complex fields that leave the panel during an exposure, of still patterns or of a video."""

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
"""Shares of an exposure and fields on the panel's pixels; the mean PSF is the weighted sum of the
fields' PSFs."""


def exposure_fields(
    modulator: Modulator, panel_state: PictureShares | FrameSequence, pictures: Pictures, tol: float
) -> WeightedFields:
    """Yield the fields on the simulator's panel during an exposure, with each field's share of it.

    Each field is computed when it is asked for. tol: relative error of averages over time.
    """
    if isinstance(panel_state, FrameSequence):
        yield from _moving(modulator, panel_state, pictures, tol)
        return
    for name, share in panel_state.shares:
        if share > 0:
            fields = modulator.iterate_still_fields(_grey_levels(pictures, name), tol=tol)
            yield from ((share * weight, field) for weight, field in fields)


def _grey_levels(pictures: Pictures, name: str) -> torch.Tensor:
    """Return the grey levels of one of the pictures on the simulator's panel, uint8."""
    return torch.from_numpy(pictures[name].copy())


def _settled_phase(modulator: Modulator, pictures: Pictures, name: str) -> torch.Tensor:
    """Return the phase in radians that the simulator's panel reaches for a still pattern."""
    return torch.as_tensor(modulator.phase(_grey_levels(pictures, name)))


def _moving(
    modulator: Modulator, seen: FrameSequence, pictures: Pictures, tol: float
) -> WeightedFields:
    """Yield the fields of a repeated video while the simulator's liquid crystal responds.

    A span within a frame is treated as a shorter frame, which begins with the phase that the
    crystal has reached by then.
    """
    tau, frame_time = modulator.panel.response_time, seen.frame_time
    # After 36 time constants a frame has no effect on the phase in double precision (e^-36).
    recent = seen.names[-max(1, math.ceil(36.0 * tau / frame_time)) :]
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
