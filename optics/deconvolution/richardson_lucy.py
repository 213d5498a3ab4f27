"""Richardson-Lucy deconvolution (thesis Eq. 2.30), with an unknown border."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.method import PREPARED, Method, Work
from optics.deconvolution.priors import divergence_of_direction, laplacian_of
from optics.deconvolution.restored import Restored, relative_change
from optics.edge import require_count
from optics.fourier import irfft2, rfft2
from optics.operators.blur import transfer_function
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded

_FLOOR = 1e-6
"""Of the mean light: less isn't divided by."""

_LEAST_SEEN = 0.01
"""Share of the best-seen place's light that gets into the frame, below which a place is left be."""

_MOST = 0.9
"""Of what a regulariser may take or give in one iteration: its factor stays positive."""


@single_threaded
def richardson_lucy(
    seen: Blurred,
    iterations: int = 30,
    *,
    accelerated: bool = True,
    total_variation: float = 0.0,
    tikhonov: float = 0.0,
    past_noise: bool = False,
    progress: Progress | None = None,
) -> Restored:
    """The picture under which the photons that were counted are the likeliest, (rows, columns).

    Negative light, which dark subtraction leaves, counts as none, and so do negative values of the
    PSF. What wasn't measured, beyond the frame or in it, is restored with the rest (Bertero and
    Boccacci 2005, doi 10.1051/0004-6361:20052717), so that it leaves no rings.

    accelerated: whether each iteration starts from where the last two lead (Biggs and Andrews
    1997, doi 10.1364/AO.36.001766), which does the work of several. total_variation, tikhonov:
    weights w of Eq. 2.30's regulariser, whose factor 1 / (1 - w Γ) has Γ = div(∇I / |∇I|) (Dey et
    al. 2006, doi 10.1002/jemt.20294) and Γ = ∇²I over the mean light. past_noise: whether it goes
    on where no more is left unexplained than noise, which it would make detail of (Morozov 1966).
    Raises ValueError for weights that are negative, or too few iterations.
    """
    require_count("iterations", iterations)
    for name, value in (("total_variation", total_variation), ("tikhonov", tikhonov)):
        if not 0 <= value < float("inf"):
            raise ValueError(f"{name} is {value:g}; give 0 or more")
    progress = progress or Progress()
    likelihood = _Likelihood.of(seen)
    path = _Path(likelihood.start(), accelerated)
    change, ended = list[float](), False
    for number in range(iterations):
        progress.report(number / iterations, f"Richardson-Lucy {number + 1}/{iterations}")
        ahead = path.ahead()
        expected = likelihood.blurred(ahead)
        if not past_noise and seen.unexplained(expected) <= 1:
            ended = True
            break
        factor = _factor(ahead, likelihood.level, total_variation, tikhonov)
        change.append(path.take(likelihood.better(ahead, expected, factor), ahead))
    picture = path.now
    name = "Richardson-Lucy" + (" with total variation" if total_variation else "")
    return Restored(
        seen.frame(picture).contiguous(),
        name,
        seen.noise,
        seen.unexplained(likelihood.blurred(picture)) ** 0.5,
        None,
        len(change),
        change,
        ended,
    )


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Of pictures on the whole period: Poisson's, of the pixels that are trusted."""

    seen: Blurred
    transfer: torch.Tensor
    back: torch.Tensor
    data: torch.Tensor
    measured: torch.Tensor
    step: torch.Tensor
    known: torch.Tensor | None
    level: float

    @classmethod
    def of(cls, seen: Blurred) -> _Likelihood:
        psf = seen.psf.clamp(min=0) / seen.gain
        transfer = transfer_function(psf, seen.whole)
        data = seen.data.clamp(min=0)
        trust = torch.ones_like(data) if seen.trust is None else seen.trust
        measured = centred_pad(trust, seen.whole)
        back = transfer.conj().resolve_conj()
        reached = irfft2(rfft2(measured) * back, seen.whole)
        least = _LEAST_SEEN * float(reached.max())
        # Where almost no light comes from into the picture, nothing is known: leave it be.
        known = reached > least
        if seen.lit is not None:
            known &= seen.lit > 0
        step = torch.where(known, 1 / reached.clamp(min=least), 0.0)
        light = float((data.detach() * trust).sum() / trust.sum() / transfer[0, 0].real)
        level = max(light, float(torch.finfo(data.dtype).tiny))
        data = centred_pad(data, seen.whole)
        everywhere = bool(known.all())
        return cls(seen, transfer, back, data, measured, step, None if everywhere else known, level)

    def start(self) -> torch.Tensor:
        """Even light; none where nothing shines."""
        even = torch.full_like(self.data, self.level)
        return even if self.seen.lit is None else even * self.seen.lit

    def blurred(self, picture: torch.Tensor) -> torch.Tensor:
        return irfft2(rfft2(picture) * self.transfer, self.seen.whole)

    def better(
        self, picture: torch.Tensor, expected: torch.Tensor, factor: torch.Tensor | None
    ) -> torch.Tensor:
        """Eq. 2.30. expected: the picture as it falls on the sensor."""
        ratio = self.data / expected.clamp(min=_FLOOR * self.level)
        ratio.mul_(self.measured)
        moved = irfft2(rfft2(ratio).mul_(self.back), self.seen.whole)
        moved.mul_(self.step).clamp_(min=0).mul_(picture)
        if factor is not None:
            moved.mul_(factor)
        return moved if self.known is None else torch.where(self.known, moved, picture)


class _Path:
    """Pictures one after the other, and where the last two lead."""

    def __init__(self, start: torch.Tensor, accelerated: bool) -> None:
        self.now, self._accelerated = start, accelerated
        self._way: torch.Tensor | None = None
        self._gains: list[torch.Tensor] = []

    def ahead(self) -> torch.Tensor:
        """Where the next iteration starts."""
        if not self._accelerated or self._way is None or len(self._gains) < 2:
            return self.now
        before, last = self._gains
        length = float(torch.dot(before.flatten(), before.flatten()))
        share = float(torch.dot(last.flatten(), before.flatten())) / length if length > 0 else 0.0
        share = min(max(share, 0.0), 1.0)
        return torch.add(self.now, self._way, alpha=share).clamp_(min=0)

    def take(self, fresh: torch.Tensor, ahead: torch.Tensor) -> float:
        """The next picture; how much it changes, relative."""
        self._way = fresh - self.now
        if self._accelerated:
            self._gains = [*self._gains[-1:], (fresh - ahead).detach()]
        before, self.now = self.now, fresh
        return relative_change(fresh, before)


def _factor(
    picture: torch.Tensor, level: float, total_variation: float, tikhonov: float
) -> torch.Tensor | None:
    """1 / (1 - w Γ)."""
    if not total_variation and not tikhonov:
        return None
    taken = torch.zeros_like(picture)
    if total_variation:
        taken.add_(divergence_of_direction(picture, 1e-3 * level), alpha=total_variation)
    if tikhonov:
        taken.add_(laplacian_of(picture), alpha=tikhonov / level)
    return taken.clamp_(max=_MOST).neg_().add_(1).reciprocal_()


def _solve(seen: Blurred, weight: float | None, *, iterations: int, progress: Progress) -> Restored:
    return richardson_lucy(seen, iterations, total_variation=weight or 0.0, progress=progress)


METHOD = Method(
    "likeliest under photon noise (Eq. 2.30), accelerated; stops at the noise",
    _solve, {10: 2.3, 20: 2.5, 30: 2.5}, 30, PREPARED, lambda _: Work(4, 60),
)  # fmt: skip
