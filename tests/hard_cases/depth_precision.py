"""Optics and designs of several depths inside torch's mixed precision."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import torch

from hard_cases.depth_designs import search, transfer_of
from hard_cases.depth_waves import CAMERA, KINDS, PIXELS, WAVELENGTH
from hard_cases.table import ONCE, Case, Holds, require_close
from optics.edof import FullTransfer, QuarterTransfer, TransferDesign
from optics.edof.parametrisation import PARAMETRISATIONS, SumOfParts, make_parametrisation
from optics.edof.protocol import convert_to_luminance
from optics.edof.protocol_psfs import bin_psf
from optics.psf import PSFOperator, PSFStack


def asked_of_optics() -> Iterator[tuple[Callable[[torch.Tensor], torch.Tensor], torch.Tensor]]:
    """Functions of a pattern, a PSF, a picture or parameters, and where they are asked."""
    rng = torch.Generator().manual_seed(3)
    rows, columns = CAMERA.panel.shape
    shapes = {
        "none": (rows, columns),
        "quarter": (rows // 2, columns // 2),
        "separable": (rows + columns,),
    }
    for symmetry, shape in shapes.items():
        phase = 3 * torch.randn(shape, generator=rng)
        yield PSFOperator(CAMERA, 0.5, WAVELENGTH, PIXELS, symmetry=symmetry), phase
        yield PSFStack(CAMERA, (math.inf, 0.5), [WAVELENGTH], PIXELS, symmetry=symmetry), phase
        if symmetry != "separable":
            kind = FullTransfer if symmetry == "none" else QuarterTransfer
            for fast in (True, False):
                design = TransferDesign(CAMERA, WAVELENGTH, 16, reach=20, fast=fast)
                yield partial(kind(design), dioptres=(0.0, 2.0)), phase
    yield partial(bin_psf, binning=3), torch.rand(11, 11, generator=rng)
    yield convert_to_luminance, torch.rand(3, 6, 7, generator=rng)
    for name in PARAMETRISATIONS:
        kept = make_parametrisation(name, CAMERA.panel.shape)
        yield kept.phase, torch.randn(kept.count, generator=rng)
    parts = SumOfParts({"a": torch.rand(8, 9, generator=rng), "b": torch.eye(8, 9)})
    yield parts.phase, torch.randn(2, generator=rng)


def in_and_out_of_autocast(inside: Callable[[], Any]) -> list[Any]:
    found = [inside()]
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found.append(inside())
    return found


def mixed_precision(tol: float) -> None:
    """The same numbers and gradients; the backward pass, too, may be inside."""
    for function, at in asked_of_optics():

        def both(function: Any = function, at: torch.Tensor = at) -> tuple[Any, Any]:
            given = at.clone().requires_grad_()
            value = function(given)
            (value.abs().double() ** 2).sum().backward()
            assert given.grad is not None
            return value.detach(), given.grad

        (value, gradient), (mixed, mixed_gradient) = in_and_out_of_autocast(both)
        assert mixed.dtype == value.dtype
        require_close(mixed, value, 1e-12)
        require_close(mixed_gradient, gradient, 1e-12)


def mixed_precision_of_a_search(tol: float) -> None:
    """The same pattern, bit by bit, and the same rating."""
    for kind in KINDS.values():
        for criterion in ("blind", "known"):
            plain, mixed = in_and_out_of_autocast(
                lambda k=kind, c=criterion: search(transfer_of(k), 2, criterion=c)
            )
            assert torch.equal(plain.phase, mixed.phase)
            assert plain.rating == mixed.rating


CASES: list[Case] = [
    Holds("optics under autocast", "torch multiplies real matrices in eight bits, in the backward "
          "pass too", "PSFs, OTFs, binning, parameters in bfloat16's scope", mixed_precision,
          "the same without", tols=ONCE),
    Holds("a search under autocast", "torch multiplies real matrices in eight bits",
          "3 steps, both criteria", mixed_precision_of_a_search, "the same without, bit by bit",
          tols=ONCE),
]  # fmt: skip
