"""A linear filter's picture and the capture, refined by a network."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import torch
from torch import nn

from optics.edof.decoders import (
    BlindDecoder,
    Decoder,
    KnownDepthDecoder,
    Restore,
    Spectrum,
    restore_by_filter,
)
from optics.edof.learned.u_net import NetworkShape, UNet, apply_in_tiles, tile_side
from optics.edof.protocol import LINEAR_BELOW, LightScale, encode_unclipped
from optics.edof.spectral_criterion import blind_filter, noise_variance
from optics.fourier import irfft2
from optics.plane import centred_crop, centred_pad, origin_to_centre
from optics.validation import require_finite, require_same_shape

Front = Literal["blind", "known", "none"]
"""The filter before the network: one for all depths, that of the capture's depth, or none."""

# Factor of the channel that holds the noise level, so that usual levels are near 1. Chosen.
_NOISE_SCALE = 20.0

# Least and largest light that the network is given, where white is 1. What a filter makes beyond
# them is ringing, whose size tells nothing more. Chosen.
_DARKEST, _BRIGHTEST = -0.25, 1.5


@dataclass(frozen=True)
class DecoderSettings:
    """What a learned decoder is given, and its size.

    Parameters
    ----------
    shape : NetworkShape, optional
        The network's size.
    front : {"blind", "known", "none"}, optional
        The filter before the network. A decoder with "known" is told the depth of each capture.
    psf_channel : bool, optional
        Whether the network is given the true PSF of each capture as a channel, as the published
        code does. Such a decoder is told the depth, too.
    light : {"srgb", "linear"}, optional
        The light of captures: "linear" light is sRGB-encoded for the network, and its result
        decoded again, so that dark and bright parts count as the eye sees them. "srgb": values are
        taken as they are.

    Raises
    ------
    ValueError
        If a word isn't one of its choices.
    """

    shape: NetworkShape = field(default_factory=NetworkShape)
    front: Front = "blind"
    psf_channel: bool = False
    light: LightScale = "srgb"

    def __post_init__(self) -> None:
        if self.front not in ("blind", "known", "none"):
            raise ValueError(f"front is {self.front!r}; choose blind, known or none")
        if self.light not in ("srgb", "linear"):
            raise ValueError(f"light is {self.light!r}; choose srgb or linear")

    @property
    def is_blind(self) -> bool:
        """Whether nothing that is given but the capture depends on its depth."""
        return self.front != "known" and not self.psf_channel

    @property
    def knowledge(self) -> str:
        """What is known of a capture's depth, in words."""
        return "blind" if self.is_blind else "told the depth"

    @property
    def inputs(self) -> int:
        """Number of channels that the network is given."""
        return 2 + (self.front != "none") + self.psf_channel

    def as_data(self) -> dict[str, Any]:
        """Return plain data, from which the settings can be made again."""
        return {**asdict(self), "shape": self.shape.as_data()}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> DecoderSettings:
        """Make settings from plain data; ValueError for unknown or missing names."""
        try:
            return cls(**{**data, "shape": NetworkShape.from_data(data["shape"])})
        except (KeyError, TypeError) as error:
            raise ValueError(f"data isn't the settings of a decoder: {error}") from None


class DecoderNetwork(nn.Module):
    """A network that corrects a filter's picture of a capture.

    Parameters
    ----------
    settings : DecoderSettings
        What it is given, and its size.
    """

    def __init__(self, settings: DecoderSettings) -> None:
        super().__init__()
        self.settings = settings
        self.refining = UNet(settings.shape, settings.inputs)

    @property
    def weight_count(self) -> int:
        """Number of weights."""
        return sum(one.numel() for one in self.parameters())

    def forward(
        self,
        captures: torch.Tensor,
        noise: torch.Tensor,
        filtered: torch.Tensor | None = None,
        psfs: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Restore captures, in the scale in which they're compared: linear light is sRGB-encoded.

        Parameters
        ----------
        captures : torch.Tensor, (pictures, 1, rows, columns)
            Captures, where white is 1. The sides are multiples of ``settings.shape.multiple``.
        noise : torch.Tensor, (pictures,)
            Standard deviation of each capture's noise.
        filtered, psfs : torch.Tensor, of the shape of `captures`, optional
            What the front made of the captures, with a front only; and the PSFs, centred, with
            peaks of 1, with a PSF channel only.

        Returns
        -------
        torch.Tensor, of the shape of `captures`
            The pictures.

        Raises
        ------
        ValueError
            If something that the settings ask for is missing, something else is given, shapes
            differ, or the sides aren't such multiples.
        """
        self._require_given(captures, filtered, psfs)
        channels = [captures] if filtered is None else [captures, filtered]
        if self.settings.light == "linear":
            channels = [encode_screen(one) for one in channels]
        base = channels[-1]
        channels.append((_NOISE_SCALE * noise)[:, None, None, None].expand_as(captures))
        if psfs is not None:
            channels.append(psfs)
        return base + self.refining(torch.cat(channels, 1))

    @torch.no_grad()
    def restore(
        self,
        capture: torch.Tensor,
        noise: float,
        filtered: torch.Tensor | None = None,
        psf: torch.Tensor | None = None,
        tile: int | None = None,
    ) -> torch.Tensor:
        """Restore one capture of any size, in tiles without seams.

        The arguments are as for calling the network, without their first two axes, and so are the
        errors; besides, the capture and the noise must be finite. The result is in the light of the
        capture.

        tile: pixels along a side of the part of the result that one tile gives; by default as many
            as take about 750 MB.
        """
        require_finite("capture", capture)
        noise_variance(noise)
        require_same_shape("capture", capture, filtered=filtered, psf=psf)
        given = [one for one in (capture, filtered, psf) if one is not None]
        stacked = torch.stack(given).to(torch.float32)[None]
        level = stacked.new_tensor([noise])

        def decode(tile: torch.Tensor) -> torch.Tensor:
            parts = list(torch.split(tile, 1, 1))
            front = parts[1] if filtered is not None else None
            return self(parts[0], level, front, parts[-1] if psf is not None else None)

        shape = self.settings.shape
        side = tile_side(shape.channels, shape.fold) if tile is None else tile
        found = apply_in_tiles(decode, stacked, shape.multiple, shape.reach, side)[0, 0]
        return decode_screen(found) if self.settings.light == "linear" else found

    def _require_given(
        self, captures: torch.Tensor, filtered: torch.Tensor | None, psfs: torch.Tensor | None
    ) -> None:
        """Raise ValueError unless what the settings say is given, in shapes that fit."""
        front, channel = self.settings.front, self.settings.psf_channel
        if (filtered is None) != (front == "none"):
            wanted = "give what it made of captures" if filtered is None else "leave filtered out"
            raise ValueError(f"front is {front}; {wanted}")
        if (psfs is None) == channel:
            wanted = "give the PSFs of captures" if psfs is None else "leave psfs out"
            raise ValueError(f"psf_channel is {channel}; {wanted}")
        require_same_shape("captures", captures, filtered=filtered, psfs=psfs)
        multiple = self.settings.shape.multiple
        if captures.ndim != 4 or any(n % multiple for n in captures.shape[-2:]):
            raise ValueError(
                f"captures are {tuple(captures.shape)}; give (pictures, 1, rows, columns) with "
                f"sides that are multiples of {multiple}"
            )


def encode_screen(light: torch.Tensor) -> torch.Tensor:
    """Encode linear light as sRGB where a filter may leave it below 0 or above 1.

    The encoding goes on below 0 along its straight start, and above 1 by the same power; light
    beyond -0.25 and 1.5 is set to these.
    """
    return encode_unclipped(light.clamp(_DARKEST, _BRIGHTEST))


def decode_screen(values: torch.Tensor) -> torch.Tensor:
    """Convert sRGB values to linear light; the inverse of `encode_screen`."""
    curved = ((values.clamp(min=12.92 * LINEAR_BELOW) + 0.055) / 1.055) ** 2.4
    return torch.where(values > 12.92 * LINEAR_BELOW, curved, values / 12.92)


def learned_decoder(network: DecoderNetwork, spectrum: Spectrum, name: str = "learned") -> Decoder:
    """Return the decoder of a trained network for an evaluation.

    Parameters
    ----------
    network : DecoderNetwork
        The network.
    spectrum : callable
        Gives the power spectrum of pictures like those that are captured, but not of those, for the
        filter before the network; see `optics.edof.decoders`.
    name : str, optional
        Name in tables.

    Returns
    -------
    BlindDecoder or KnownDepthDecoder
        The first if nothing but the capture tells the network of its depth.
    """
    on_grid, settings = functools.cache(spectrum), network.settings

    def build(transfer: torch.Tensor, noise: float) -> Restore:
        side = int(transfer.shape[-2])
        filtering: Restore | None = None
        if settings.front != "none":
            filtering = restore_by_filter(blind_filter(transfer, on_grid(side), noise), noise)
        psf: torch.Tensor | None = None
        if settings.psf_channel:
            psf = origin_to_centre(irfft2(transfer[0], (side, side))).to(torch.float32)

        def restore(capture: torch.Tensor) -> torch.Tensor:
            filtered = None if filtering is None else filtering(capture)
            shape = (int(capture.shape[0]), int(capture.shape[1]))
            channel = None if psf is None else fit_psf(psf, shape)
            return network.restore(capture, noise, filtered, channel)

        return restore

    if settings.is_blind:
        return BlindDecoder(name, build)
    return KnownDepthDecoder(name, lambda transfer, noise: build(transfer[None], noise))


def fit_psf(psf: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Bring a centred PSF, (..., rows, columns), to a picture's size and a peak of 1.

    It is cut, or continued by zeros.
    """
    cut = tuple(min(n, m) for n, m in zip(psf.shape[-2:], shape, strict=True))
    fitted = centred_pad(centred_crop(psf, (cut[0], cut[1])), shape)
    return fitted / fitted.amax((-2, -1), keepdim=True)
