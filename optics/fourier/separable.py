"""Fourier transforms that apply a one-dimensional rule along one axis after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import torch

from optics.fourier.geometry import FourierGeometry
from optics.fourier.transform import PlaneTransform


class AxisRule(ABC):
    """Base class of Fourier sums along one axis, from n centred samples to m centred samples:

        C[k] = sum over j of f[j] exp(-2 pi i step (j - n // 2) (k - m // 2)).

    The sum and its adjoint work along the second last axis, (..., n or m, lines).
    """

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Compute the Fourier sum, from (..., n, lines) to (..., m, lines)."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of the Fourier sum, from (..., m, lines) to (..., n, lines)."""

    @abstractmethod
    def to(self, device: torch.device) -> None:
        """Move the precomputed arrays of the Fourier sum to a device."""


class SeparableTransform(PlaneTransform):
    """Base class of Fourier transforms that apply one rule along y, then one along x.

    Planes that are off centre are handled by a phase factor before or after each rule.
    """

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        self._rules: tuple[AxisRule, AxisRule] | None = None

    @cached_property
    def _pupil_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Return the Fourier phases over the pupil along y and x for an off-centre image.

        They are computed at the first call, since many transforms are only asked for their cost.
        """
        return tuple(self.geometry.pupil_tilt(axis, self.dtype) for axis in (0, 1))

    @cached_property
    def _image_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Return the Fourier phases over the image along y and x for an off-centre pupil."""
        return tuple(self.geometry.image_tilt(axis, self.dtype) for axis in (0, 1))

    @abstractmethod
    def build_axis_rule(self, axis: int) -> AxisRule:
        """Build the rule of the Fourier transform along axis 0 (y) or 1 (x)."""

    def axis_rules(self, device: torch.device) -> tuple[AxisRule, AxisRule]:
        """Return the Fourier sums along y and x on a device; they are built at the first call."""
        if self._rules is None:
            self._rules = (self.build_axis_rule(0), self.build_axis_rule(1))
        for rule in self._rules:
            rule.to(device)
        return self._rules

    def _forward_axis(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        """Fourier-transform a field along its second last dimension, which belongs to `axis`."""
        before, after = self._pupil_phases[axis], self._image_phases[axis]
        if before is not None:
            field = field * before.to(field.device)[:, None]
        field = rule.forward(field)
        return field if after is None else field * after.to(field.device)[:, None]

    def _adjoint_axis(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        before, after = self._pupil_phases[axis], self._image_phases[axis]
        if after is not None:
            field = field * after.conj().to(field.device)[:, None]
        field = rule.adjoint(field)
        return field if before is None else field * before.conj().to(field.device)[:, None]

    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Apply the Fourier transform's rule of one axis to a field."""
        rule, field = self.axis_rules(field.device)[axis], field.to(self.dtype)
        if axis == 0:
            return self._forward_axis(field, 0, rule)
        return self._forward_axis(field.mT.contiguous(), 1, rule).mT

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._forward_axis(self._forward_axis(field, 0, y).mT.contiguous(), 1, x).mT

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._adjoint_axis(
            self._adjoint_axis(field.mT.contiguous(), 1, x).mT.contiguous(), 0, y
        )

    def lines(self) -> tuple[int, int]:
        """Return how many lines of samples the Fourier transform has along y and along x."""
        return self.geometry.pupil.shape[1], self.geometry.image.shape[0]
