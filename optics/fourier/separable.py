"""Transforms that go along one axis after the other, by the same one-dimensional rule."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import torch

from optics.fourier.geometry import FourierGeometry
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

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        super().__init__(geometry, dtype)
        self._rules: tuple[AxisRule, AxisRule] | None = None

    @cached_property
    def _pupil_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the pupil, made at the first call; an offer makes nothing."""
        return tuple(self.geometry.pupil_tilt(axis, self.dtype) for axis in (0, 1))

    @cached_property
    def _image_phases(self) -> tuple[torch.Tensor | None, ...]:
        """Phases over the image."""
        return tuple(self.geometry.image_tilt(axis, self.dtype) for axis in (0, 1))

    @abstractmethod
    def build_axis_rule(self, axis: int) -> AxisRule:
        """The rule along axis 0 (y) or 1 (x); made at the first call, and kept."""

    def axis_rules(self, device: torch.device) -> tuple[AxisRule, AxisRule]:
        """The rules along y and x, made once, on a device."""
        if self._rules is None:
            self._rules = (self.build_axis_rule(0), self.build_axis_rule(1))
        for rule in self._rules:
            rule.to(device)
        return self._rules

    def _forward_axis(self, field: torch.Tensor, axis: int, rule: AxisRule) -> torch.Tensor:
        """Along the second last dimension, which is that of `axis`."""
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

    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._forward_axis(self._forward_axis(field, 0, y).mT.contiguous(), 1, x).mT

    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        y, x = self.axis_rules(field.device)
        return self._adjoint_axis(
            self._adjoint_axis(field.mT.contiguous(), 1, x).mT.contiguous(), 0, y
        )

    def lines(self) -> tuple[int, int]:
        """How often the rule of each axis is applied."""
        return self.geometry.pupil.shape[1], self.geometry.image.shape[0]
