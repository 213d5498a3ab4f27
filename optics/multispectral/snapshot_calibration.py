"""The state of knowledge of a snapshot camera's model: estimates, uncertainty, and what's open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch

from optics.multispectral.snapshot_model import ModelUncertainty, SnapshotModel
from optics.validation import require_finite, require_unmasked

NINETY_PERCENT = 1.6449  # half-width of a normal variable's 90 % interval, in standard deviations
_SHIFT_STEPS = 20  # of the shift that most bands share; more change less than 1e-6 pixels

_NO_GAINS = (
    "Each band's overall gain: a brighter band and a more sensitive camera give the same "
    "photograph. Each band's response keeps the sum of its nominal one over the channels."
)
_NO_SHIFT = (
    "A shift of all bands together: a moved scene and moved PSFs give the same photograph. The "
    "centres are relative to where most bands are, each counted by its certainty."
)


@dataclass(frozen=True, eq=False)
class BandTransmission:
    """What a spectroradiometer says of the filter: its transmission in each band.

    Parameters
    ----------
    values, deviations : torch.Tensor or numpy.ndarray, (bands,)
        Transmission of each band relative to the nominal response, above 0, and its standard
        deviation, 0 or more.

    Raises
    ------
    ValueError
        For values that aren't positive and finite, or a negative deviation.
    """

    values: Any
    deviations: Any

    def __post_init__(self) -> None:
        require_unmasked(self.values, self.deviations)
        for name in ("values", "deviations"):
            tensor = torch.as_tensor(getattr(self, name)).to(torch.float64)
            require_finite(name, tensor)
            object.__setattr__(self, name, tensor)
        if self.values.ndim != 1 or self.values.shape != self.deviations.shape:
            raise ValueError(
                f"values are {tuple(self.values.shape)} and deviations "
                f"{tuple(self.deviations.shape)}; give one number for each band in both"
            )
        if not bool((self.values > 0).all()) or bool((self.deviations < 0).any()):
            raise ValueError("a transmission must be above 0, and its deviation 0 or more")


@dataclass(frozen=True)
class CalibratedParameter:
    """One parameter of a camera, with its uncertainty.

    Attributes
    ----------
    name, unit : str
        What it is, in words; "pixel", or nothing for shares and ratios.
    value, nominal, deviation : float
        The estimate, what the nominal model has, and the standard deviation.
    lower, upper : float
        Ends of the 90 % interval.
    """

    name: str
    unit: str
    value: float
    nominal: float
    deviation: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class SnapshotCalibration:
    """The calibrated model of a snapshot spectral camera.

    `nominal` makes the first one, and `calibrate_from_frames` and `refine_from_photograph` better
    ones.

    Attributes
    ----------
    model : SnapshotModel
        The nominal model with its parameters.
    deviation, covariance : torch.Tensor, (parameters,) and (parameters, parameters), float64
        Estimated deviation of each parameter from nominal (see ParameterLayout), and covariance of
        its errors, with the shift of all bands together.
    transmission, source : BandTransmission, optional, and str
        Transmission of each band, whose gains are indeterminate if None; what the estimates come
        from, in words.
    """

    model: SnapshotModel
    deviation: torch.Tensor
    covariance: torch.Tensor
    transmission: BandTransmission | None = None
    source: str = "nominal"

    @classmethod
    def nominal(
        cls,
        model: SnapshotModel,
        uncertainty: ModelUncertainty | None = None,
        transmission: BandTransmission | None = None,
    ) -> SnapshotCalibration:
        """Return what is known of a camera before any calibration.

        `uncertainty` is that of the nominal model, and `transmission` the bands' as measured.
        Raises ValueError for a transmission of another number of bands.
        """
        if transmission is not None and len(transmission.values) != model.bands:
            raise ValueError(
                f"transmission has {len(transmission.values)} bands; the model has {model.bands}"
            )
        covariance = model.layout.prior_covariance(uncertainty or ModelUncertainty())
        deviation = torch.zeros(model.layout.count, dtype=torch.float64)
        return cls(model, deviation, covariance, transmission)

    def with_estimates(
        self, deviation: torch.Tensor, covariance: torch.Tensor, source: str
    ) -> SnapshotCalibration:
        return replace(self, deviation=deviation, covariance=covariance, source=source)

    @cached_property
    def _shift_removal(self) -> torch.Tensor:
        """The matrix that takes off the shift that most bands have in common.

        A band that lies beside the others counts less, so that one displaced band doesn't displace
        what all the others are compared with.
        """
        layout, bands = self.model.layout, self.model.bands
        alike = torch.full((bands,), 1 / bands, dtype=torch.float64)
        mean_removal = layout.shift_removal([alike, alike])
        relative = mean_removal @ self.covariance @ mean_removal.mT
        spread = relative.diagonal()[layout.centres].clamp(min=1e-12).sqrt().reshape(2, -1)
        places = self.deviation[layout.centres].reshape(2, -1)
        shares = []
        for place, deviation in zip(places, spread, strict=True):
            share = torch.full_like(place, 1 / len(place))
            for _ in range(_SHIFT_STEPS):
                beside = (place - share @ place) / deviation
                share = 1 / (deviation.square() * (1 + beside.square()).sqrt())
                share = share / share.sum()
            shares.append(share)
        return layout.shift_removal(shares)

    def remove_common_shift(self, deviation: torch.Tensor) -> torch.Tensor:
        """Take off deviations from nominal the shift that this calibration calls common.

        True ones of a simulated camera can then be compared with `relative_deviation`.
        """
        return self._shift_removal @ deviation

    @property
    def relative_deviation(self) -> torch.Tensor:
        """Deviations from nominal without the bands' common shift."""
        return self.remove_common_shift(self.deviation)

    @property
    def relative_covariance(self) -> torch.Tensor:
        return self._shift_removal @ self.covariance @ self._shift_removal.mT

    @property
    def psfs(self) -> torch.Tensor:
        """Calibrated PSFs, (bands, rows, columns), float64."""
        return self.model.psfs(self.relative_deviation)

    @property
    def response(self) -> torch.Tensor:
        """Calibrated response, (channels, bands), float64."""
        response = self.model.response_at(self.relative_deviation)
        return response if self.transmission is None else response * self.transmission.values

    @property
    def indeterminate(self) -> tuple[str, ...]:
        """What the calibration can't tell, and how it is fixed, in sentences."""
        return (_NO_SHIFT,) if self.transmission is not None else (_NO_GAINS, _NO_SHIFT)

    @property
    def parameters(self) -> tuple[CalibratedParameter, ...]:
        """All parameters with standard deviations and 90 % intervals."""
        model, found = self.model, self.relative_deviation
        spread, bands = self.relative_covariance.diagonal().clamp(min=0).sqrt(), range(model.bands)
        shares = model.zeroth_order.tolist()
        additive = [
            *((f"zeroth order's share of band {n}", "", shares[n]) for n in bands),
            ("size of the coded PSFs", "", 1.0),
            *((f"centre {letter} of band {n}", "pixel", 0.0) for letter in "yx" for n in bands),
        ]
        first = model.layout.log_ratios.start
        listed = [
            _additive(*one, change, deviation)
            for one, change, deviation in zip(additive, found[:first], spread[:first], strict=True)
        ]
        ratios = [
            (n, int(channel)) for channels in model.others for n, channel in enumerate(channels)
        ]
        for one, change, deviation in zip(ratios, found[first:], spread[first:], strict=True):
            listed.append(self._ratio(*one, change, deviation))
        if self.transmission is not None:
            known = zip(self.transmission.values, self.transmission.deviations, strict=True)
            for band, (value, deviation) in enumerate(known):
                name = f"transmission of band {band}"
                listed.append(_additive(name, "", 1.0, value - 1, deviation))
        return tuple(listed)

    def _ratio(
        self, band: int, channel: int, log: torch.Tensor, spread: torch.Tensor
    ) -> CalibratedParameter:
        """Return a ratio of two channels' responses, whose logarithm is estimated."""
        letters, first = self.model.channels, int(self.model.strongest[band])
        nominal = float(self.model.response[channel, band] / self.model.response[first, band])
        value, deviation = nominal * math.exp(float(log)), float(spread)
        half = math.exp(NINETY_PERCENT * deviation)
        name = f"{letters[channel]}/{letters[first]} of band {band}"
        return CalibratedParameter(
            name, "", value, nominal, value * deviation, value / half, value * half
        )


def _additive(
    name: str, unit: str, nominal: float, change: torch.Tensor, spread: torch.Tensor
) -> CalibratedParameter:
    """Return a parameter whose difference from its nominal value is estimated."""
    value, deviation = nominal + float(change), float(spread)
    half = NINETY_PERCENT * deviation
    return CalibratedParameter(name, unit, value, nominal, deviation, value - half, value + half)
