"""All bands at once, by a convex prior on brightness and colours."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from optics.deconvolution.border import continued
from optics.deconvolution.restored import relative_change
from optics.demosaicing.colours import Bends
from optics.demosaicing.mosaiced import Mosaiced
from optics.fourier import irfft2, rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_BRIGHTNESS = 0.4
"""Weight of brightness' curvature beside that of colours."""

_STEP = 0.5
"""Of the light's standard deviation: the curvature that a first iteration takes for none."""

_LEAST, _NOISE = 1e-3, 2.2
"""Weights on the light's scale: of a picture without noise, and a noise's square to be added."""

_TINY = 1e-9


@single_threaded
@torch.no_grad()
def jointly(
    seen: Mosaiced,
    period: Sequence[int],
    weight: float | None = None,
    *,
    iterations: int = 30,
    progress: Progress | None = None,
) -> torch.Tensor:
    """(bands, rows, columns) of light: the least of |S G x - y|² / 2 + weight * Bends(x), trusted
    pixels alone.

    By the alternating direction method of multipliers (Boyd et al. 2011, doi 10.1561/2200000016):
    curvatures and the light before the filters are split off, and each step has a closed form, the
    filters' a pixel's own (Sherman and Morrison's). period: of the pattern, (rows, columns).
    """
    splitting = _Splitting(seen, period, weight)
    progress = progress or Progress()
    for number in range(iterations):
        progress.report(number / iterations, f"demosaicing {number + 1}/{iterations}")
        splitting.step()
    return splitting.picture()


def usual_weight(noise: float, scale: float) -> float:
    """Of the prior, for a noise and a scale of the light."""
    return scale * (_LEAST + _NOISE * (noise / scale) ** 2)


class _Splitting:
    """The state between two iterations, of light over the filters' gain."""

    def __init__(self, seen: Mosaiced, period: Sequence[int], weight: float | None) -> None:
        self._seen, gain = seen, seen.gain
        self._filters, self._data = seen.filters / gain, seen.raw / gain
        self._trust = torch.ones_like(self._data) if seen.trust is None else seen.trust
        used = usual_weight(seen.noise / gain, seen.scale) if weight is None else weight
        step = _STEP * seen.scale
        # Coupling of both splits: it makes one step of the length that is told.
        self._held = used / step
        bands = len(seen.filters)
        self._bends = Bends(bands, seen.whole, _BRIGHTNESS, step, self._data.dtype)
        self._inverse = self._inverted()
        self._x = torch.stack([continued(one, seen.whole) for one in seen.start(period)])
        self._dual = torch.zeros((bands, *seen.frame), dtype=self._data.dtype)
        self.change: list[float] = []
        self._bent = self._bends.back(self._mixed(self._x))
        self._light = self._filtered(self._blurred(rfft2(self._x), self._x))

    def step(self) -> None:
        colours = self._bends.colours
        pulled = rfft2(self._light)
        if self._seen.transfer is not None:
            pulled = pulled * self._seen.transfer.conj()
        wanted = pulled + rfft2(_turned(colours.mT, self._bent))
        spectrum = self._solved(wanted)
        before, self._x = self._x, irfft2(spectrum, self._seen.whole)
        self.change.append(relative_change(self._x.flatten(0, 1), before.flatten(0, 1)))
        self._bent = self._bends.back(self._mixed(self._x))
        self._light = self._filtered(self._blurred(spectrum, self._x))

    def picture(self) -> torch.Tensor:
        return self._seen.seen(self._x).clone()

    def _mixed(self, x: torch.Tensor) -> torch.Tensor:
        return _turned(self._bends.colours, x)

    def _blurred(self, spectrum: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """The light before the filters; may be written over."""
        transfer = self._seen.transfer
        return x.clone() if transfer is None else irfft2(spectrum * transfer, self._seen.whole)

    def _filtered(self, light: torch.Tensor) -> torch.Tensor:
        """v - u of the next step: what the numbers make of the light, and what it was pulled."""
        inside = self._seen.seen(light)
        moved = inside + self._dual
        left = self._data - (self._filters * moved).sum(0)
        if self._seen.clipped is not None:
            trust = torch.where(self._seen.clipped, (left > 0).to(left), self._trust)
        else:
            trust = self._trust
        below = self._held + trust * self._filters.square().sum(0)
        taken = self._filters * (trust * left / below)
        # u is now -taken, and v - u is twice that from where it was moved.
        self._dual = -taken
        inside.copy_(moved.add_(taken, alpha=2))
        return light

    def _inverted(self) -> torch.Tensor:
        """Of G* G + D^T D: of each colour where all bands are blurred alike, else of all bands,
        (bands, bands) a frequency."""
        bends, transfer = self._bends, self._seen.transfer
        weights = bends.weights.square()
        if transfer is None or len(transfer) == 1:
            power = 1.0 if transfer is None else transfer.abs().square()
            return (weights[:, None, None] * bends.square + power + _TINY).reciprocal_()
        shared = bends.colours.mT @ (weights[:, None] * bends.colours)
        own = torch.diag_embed(transfer.abs().square().movedim(0, -1) + _TINY)
        return torch.linalg.inv(own + bends.square[..., None, None] * shared)

    def _solved(self, wanted: torch.Tensor) -> torch.Tensor:
        if self._inverse.ndim == 3:
            colours = self._bends.colours
            return _turned(colours.mT, _turned(colours, wanted).mul_(self._inverse))
        matrix = self._inverse.to(wanted.dtype)
        return (matrix @ wanted.movedim(0, -1)[..., None])[..., 0].movedim(-1, 0)


def _turned(matrix: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """A matrix times the bands of each pixel."""
    return torch.tensordot(matrix.to(x.dtype), x, 1)
