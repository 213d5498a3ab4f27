"""Restoration of a photograph of several depths, all of them together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from optics.deconvolution.blurred import Blurred
from optics.deconvolution.layered import Layered
from optics.deconvolution.noise import squared
from optics.deconvolution.normal import solved_on_frequencies
from optics.deconvolution.priors import Bounds, Prior, TotalVariation
from optics.deconvolution.restored import Restored, relative_change
from optics.deconvolution.shrinkage import require_power
from optics.deconvolution.splitting import LEAST_FREEDOM, towards
from optics.deconvolution.total_variation import STEP, first_weight
from optics.deconvolution.wiener import penalty_of
from optics.edge import require_count, require_positive
from optics.fourier import half_counts, irfft2, rfft2
from optics.operators.blur import transfer_function
from optics.operators.contract import Operator
from optics.operators.occluding import OccludingBlur
from optics.operators.varying import VaryingBlur
from optics.plane import centred_pad
from optics.progress import Progress
from optics.threads import single_threaded

_SETTLING, _FARTHEST = 3, 8.0
"""Iterations after which a weight that is looked for moves, and how far it may, as a factor: the
spectrum of several depths tells little about where it begins."""


@single_threaded
@torch.no_grad()
def depths(
    seen: Layered,
    weight: float | None = None,
    *,
    power: float = 1.0,
    occlusion: bool = True,
    iterations: int = 20,
    inner: int = 10,
    tol: float = 0.0,
    positive: bool = False,
    progress: Progress | None = None,
) -> Restored:
    """The scene of least |H X - O|² / 2, trusted pixels alone, + weight * gradients' lengths to a
    power, with the PSF of each depth where that depth is (thesis Fig. 2.17).

    weight, power, positive, tol: as for total_variation(). occlusion: whether nearer layers, the
    first ones, hide the farther ones, as things do; then each layer is looked for behind what hides
    it as well, and the picture is put together of what is seen. inner: steps of conjugate gradients
    in each iteration.

    By the alternating direction method of multipliers with gradients split off (Boyd et al. 2011,
    doi 10.1561/2200000016). The picture's step has no closed form where PSFs differ; it is solved
    from the last one on by conjugate gradients, preconditioned by the layers' mean power. What was
    clipped counts where the picture has less light there than was measured.

    Not modelled: depth beyond the frame, where the layers of its edge go on; layers that aren't
    where the map says; and what OccludingBlur leaves out.
    Raises ValueError for a weight that isn't positive, a power outside 0 to 1, or no iteration.
    """
    if weight is not None:
        require_positive("weight", weight, "")
    require_power(power)
    require_count("iterations", iterations)
    require_count("inner", inner)
    progress, equations = progress or Progress(), _Equations(seen, occlusion)
    priors = [_Priors(seen, power, positive) for _ in range(equations.pictures)]
    first = first_weight(seen, power)
    used, change, converged = first if weight is None else weight, list[float](), tol == 0
    pictures = seen.continued.expand(equations.pictures, *seen.whole).clone()
    spectra = rfft2(pictures)
    for number in range(iterations):
        progress.report(number / iterations, f"depths {number + 1}/{iterations}")
        below = torch.stack([one.below(used) for one in priors])
        spectra = equations.solved(spectra, below, [one.wanted(used) for one in priors], inner)
        before, pictures = pictures, irfft2(spectra, seen.whole)
        equations.look(pictures)
        for one, picture in zip(priors, pictures, strict=True):
            one.step(picture)
        if weight is None and number >= _SETTLING:
            freedom = max(1 - equations.squares, LEAST_FREEDOM)
            each = (one.gradients.weight(seen.deviation, freedom) for one in priors)
            used = towards(1 / sum(1 / w for w in each), used, first, _FARTHEST)
        change.append(relative_change(equations.visible(pictures), equations.visible(before)))
        if tol and change[-1] <= tol:
            converged = True
            break
    whole = equations.visible(pictures)
    return Restored(
        seen.frame(whole).clamp(min=0),
        "depths" + (", hiding each other" if occlusion else ""),
        seen.noise,
        equations.squares**0.5,
        used,
        len(change),
        change,
        converged,
        whole,
    )


@single_threaded
@torch.no_grad()
def smooth_depths(
    seen: Layered, weight: float | None = None, *, occlusion: bool = True, steps: int = 40
) -> Restored:
    """The same with a weight on the gradient's square: wiener()'s "gradient", linear, for a PSF
    that differs with depth. weight: the one with the least predicted error if None."""
    penalty, used = penalty_of(seen, weight, "gradient")
    equations = _Equations(seen, occlusion)
    pictures = seen.continued.expand(equations.pictures, *seen.whole)
    # A layer that the frame doesn't show, and where nothing is known of it, is as bright as others.
    below = penalty.clamp(min=1e-6 * used).expand(equations.pictures, *penalty.shape)
    nothing = [None] * equations.pictures
    spectra = equations.solved(rfft2(pictures), below, nothing, steps)
    pictures = irfft2(spectra, seen.whole)
    equations.look(pictures)
    whole = equations.visible(pictures)
    return Restored(
        seen.frame(whole), "depths, gradient", seen.noise, equations.squares**0.5, used,
        1 + steps, whole=whole,
    )  # fmt: skip


def pasted(seen: Layered, restore: Callable[[Blurred], Restored]) -> torch.Tensor:
    """Of restorations of all of the photograph with each layer's PSF, what is that layer: quick,
    but wrong where a layer's light has spread over another."""
    each = [restore(seen.layer(k)).image for k in range(len(seen.psfs))]
    return (torch.stack(each) * seen.shares).sum(0)


class _Priors:
    """Of one picture."""

    def __init__(self, seen: Layered, power: float, positive: bool) -> None:
        dtype = seen.image.dtype
        self.gradients = TotalVariation(seen.whole, STEP * seen.scale, power, dtype)
        bounded = positive or seen.border == "dark"
        bounds = [Bounds(seen.whole, seen.lit, dtype)] if bounded else []
        self._all: list[Prior] = [self.gradients, *bounds]

    def below(self, weight: float) -> torch.Tensor:
        parts = [prior.coupling(weight, 1.0) * prior.square for prior in self._all]
        return sum(parts[1:], parts[0])

    def wanted(self, weight: float) -> torch.Tensor | None:
        backs = [prior.back * prior.coupling(weight, 1.0)
                 for prior in self._all if prior.back is not None]  # fmt: skip
        return sum(backs[1:], backs[0]) if backs else None

    def step(self, picture: torch.Tensor) -> None:
        for prior in self._all:
            prior.step(picture)


class _Equations:
    """(H* M H + K) x = H* M y + what priors want, of one picture or one for each layer."""

    def __init__(self, seen: Layered, occlusion: bool) -> None:
        self._seen, self._occlusion = seen, occlusion
        psfs = seen.psfs / seen.gain
        self._blur: Operator = (OccludingBlur if occlusion else VaryingBlur)(psfs, seen.around)
        self.pictures = len(psfs) if occlusion else 1
        self._count = half_counts(seen.whole[1])
        self._near = seen.power[None]
        if occlusion:
            self._near = squared(transfer_function(psfs, seen.whole))
        self._trust = seen.trust
        self._measured = seen.data if seen.trust is None else seen.data * seen.trust
        self.squares = 1.0

    def visible(self, pictures: torch.Tensor) -> torch.Tensor:
        """Of all layers what is seen, on the whole period."""
        return (pictures * self._seen.around).sum(0) if self._occlusion else pictures[0]

    def solved(
        self,
        spectra: torch.Tensor,
        below: torch.Tensor,
        wanted: Sequence[torch.Tensor | None],
        steps: int,
    ) -> torch.Tensor:
        """Spectra of x, from those that are given. below: K of each frequency of each picture."""
        right = rfft2(self._back(self._measured))
        for k, one in enumerate(wanted):
            if one is not None:
                right[k] += rfft2(one)
        inverse = (self._near + below).clamp(min=1e-12).reciprocal_()

        def normal(x: torch.Tensor) -> torch.Tensor:
            light = self._seen.frame(self._light(irfft2(x, self._seen.whole)))
            kept = light if self._trust is None else light * self._trust
            return rfft2(self._back(kept)).add_(below * x)

        found, _ = solved_on_frequencies(normal, right, spectra, inverse, self._count, steps)
        return found

    def look(self, pictures: torch.Tensor) -> None:
        """What they leave unexplained, and which clipped pixels have too little light."""
        seen, light = self._seen, self._light(pictures)
        self.squares = seen.unexplained(light)
        if seen.clipped is None:
            return
        dim = (seen.clipped & (seen.frame(light) < seen.data)).to(seen.image)
        weights = dim if seen.weights is None else dim * seen.weights
        self._trust = weights if seen.trust is None else seen.trust + weights
        self._measured = seen.data * self._trust

    def _light(self, pictures: torch.Tensor) -> torch.Tensor:
        light: torch.Tensor = self._blur(pictures if self._occlusion else pictures[0])
        return light

    def _back(self, frame: torch.Tensor) -> torch.Tensor:
        back: torch.Tensor = self._blur.adjoint(centred_pad(frame, self._seen.whole))
        return back if self._occlusion else back[None]
