"""Transforms that go along one axis after the other, by the same one-dimensional rule."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import torch

from optics.fourier.geometry import Geometry
from optics.fourier.transform import PlaneTransform


class AxisRule(ABC):
    """A sum along one axis, from n centred samples to m of them:

        C[k] = sum over j of f[j] exp(-2 pi i step (j - n // 2) (k - m // 2)).

    Both ways work along the second last dimension of (..., n or m, lines).
    """

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor: ...

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor: ...

    @abstractmethod
    def to(self, device: torch.device) -> None:
        """Move what is kept to a device."""


class SeparableTransform(PlaneTransform):
    """Rows, then columns; off-centre planes cost a phase on either side of the rule."""

    def __init__(self, geometry: Geometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        self._rules: tuple[AxisRule, AxisRule] | None = None

    @cached_property
    def _before(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the pupil, made at the first call; an offer makes nothing."""
        return tuple(self.geometry.pupil_tilt(axis, self.dtype) for axis in (0, 1))

    @cached_property
    def _after(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the image."""
        return tuple(self.geometry.image_tilt(axis, self.dtype) for axis in (0, 1))

    @abstractmethod
    def rule(self, axis: int) -> AxisRule:
        """The rule along axis 0 (y) or 1 (x); made at the first call, and kept."""

    def prepared(self, device: torch.device) -> tuple[AxisRule, AxisRule]:
        """The rules along y and x, made once, on a device."""
        if self._rules is None:
            self._rules = (self.rule(0), self.rule(1))
        for rule in self._rules:
            rule.to(device)
        return self._rules

    def _across(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        """Along the second last dimension, which is that of `axis`."""
        before, after = self._before[axis], self._after[axis]
        if before is not None:
            field = field * before.to(field.device)[:, None]
        field = rule.forward(field)
        return field if after is None else field * after.to(field.device)[:, None]

    def _back(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        before, after = self._before[axis], self._after[axis]
        if after is not None:
            field = field * after.conj().to(field.device)[:, None]
        field = rule.adjoint(field)
        return field if before is None else field * before.conj().to(field.device)[:, None]

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.prepared(field.device)
        return self._across(self._across(field, 0, y).mT.contiguous(), 1, x).mT

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.prepared(field.device)
        return self._back(self._back(field.mT.contiguous(), 1, x).mT.contiguous(), 0, y)

    def lines(self) -> tuple[int, int]:
        """How often the rule of each axis is applied."""
        return self.geometry.pupil.shape[1], self.geometry.image.shape[0]
