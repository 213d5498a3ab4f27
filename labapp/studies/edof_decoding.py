"""Decode pictures taken behind the patterns for extended depth of field, and score them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from labapp.common.errors import UserError
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.edof import EdofSettings
from labapp.studies.edof_pattern import (
    DESIGNED,
    NEUTRAL,
    PATTERNS,
    pattern_in_pupil,
    trained_pattern,
)
from optics import metrics
from optics.camera import Camera
from optics.edof.decoders import BlindDecoder, blind_wiener, decoding_transfers
from optics.edof.learned import learned_decoder
from optics.edof.picture_spectrum import NATURAL_SPECTRUM, FrequencyGrid
from optics.edof.protocol import STRICT, encode_srgb
from optics.edof.protocol_psfs import PupilPattern, compute_depth_psfs
from optics.plane import centred_crop
from optics.progress import Progress

PRINT, OBJECTS = "photograph", "objects"
"""Begin the names of the scene's targets: a print at many distances, and objects at several."""

SHARP = "sharp"
"""Ends the names of the targets that show the same things in focus."""

_WHITE_PERCENTILE = 99.9
"""Of the picture in focus; a few brighter pixels don't count. Chosen."""

Restore = Callable[[torch.Tensor, float], torch.Tensor]
"""Restores a picture (rows, columns), white at 1, with noise of a standard deviation."""


@dataclass(frozen=True, eq=False)
class NamedDecoder:
    """A decoder with its name in tables.

    is_blind: whether it isn't told the depth; None for pictures that aren't decoded.
    """

    name: str
    is_blind: bool | None
    restore: Restore

    @property
    def label(self) -> str:
        """The decoder's name for a row, with what it is told."""
        if self.is_blind is None:
            return self.name
        return f"{self.name}, {'blind' if self.is_blind else 'told the depth'}"


@dataclass(frozen=True, eq=False)
class DecodedPicture:
    """Hold a picture, as taken or decoded, with the scores of its scored part.

    image: the decoded part of the frame, (rows, columns); white is 1.
    psnr: in linear light with peak 1, dB.
    srgb_psnr: in sRGB values with peak 1, dB.
    ssim: in sRGB values with range 1.
    noise: standard deviation of a pixel's noise as taken, where white is 1.
    """

    image: Picture
    psnr: float
    srgb_psnr: float
    ssim: float
    noise: float

    @property
    def scores(self) -> str:
        """The scores in words."""
        return f"{self.psnr:.1f} dB; in sRGB {self.srgb_psnr:.1f} dB, SSIM {self.ssim:.2f}"


Pictures = Mapping[tuple[str, str, str], DecodedPicture]
"""Decoded pictures by target, pattern, and label of the decoder."""


def photograph_name(distance: float) -> str:
    """Return the target name of the print at a distance in metres."""
    return f"{PRINT}-{distance * 100:.0f}cm"


def decoders_of(
    pattern: PupilPattern, camera: Camera, settings: EdofSettings
) -> list[NamedDecoder]:
    """Return the decoders for pictures behind a pattern.

    The first one gives pictures back as they are.
    """
    side = min(settings.frame_px, *camera.sensor.shape)
    protocol = replace(
        STRICT,
        name="bench",
        wavelength=settings.wavelength_nm * 1e-9,
        pixel_pitch=camera.sensor.pitch,
        pixel_response="area",
        crop=side,
        centre=min(settings.scored_px, side),
        border="true",
    )
    psfs = compute_depth_psfs(pattern, protocol.design_dioptres, camera, protocol)
    transfers = decoding_transfers(psfs, protocol)
    wiener = blind_wiener(lambda side: NATURAL_SPECTRUM.on_grid(FrequencyGrid(side)))
    decoders = [
        NamedDecoder("as taken", None, lambda picture, noise: picture),
        NamedDecoder("one Wiener filter", True, _build_restore(wiener, transfers)),
    ]
    trained = trained_pattern(settings)
    learned = learned_decoder(trained.network, trained.spectrum_on_grid)
    if isinstance(learned, BlindDecoder):
        network = NamedDecoder("filter and network", True, _build_restore(learned, transfers))
        decoders.append(network)
    return decoders


def _build_restore(decoder: BlindDecoder, transfers: torch.Tensor) -> Restore:
    """Return what a blind decoder restores pictures by, for simulated PSFs."""
    built: dict[float, Callable[[torch.Tensor], torch.Tensor]] = {}

    def restore(picture: torch.Tensor, noise: float) -> torch.Tensor:
        if noise not in built:
            built.clear()
            built[noise] = decoder.build(transfers, noise)
        return built[noise](picture)

    return restore


@dataclass(frozen=True, eq=False)
class SharpPicture:
    """Hold what pictures of one kind should be.

    image: the part of the frame that is decoded, (rows, columns); white is 1.
    white: electrons per second of a white pixel.
    """

    image: Picture
    white: float


def find_sharp_pictures(
    record: Record, brackets: list[Bracket], settings: EdofSettings
) -> dict[str, SharpPicture]:
    """Find what prints and objects look like in focus; UserError if they are dark."""
    found = {}
    for kind in (PRINT, OBJECTS) if settings.layered else (PRINT,):
        light, _ = _take_picture(record, brackets, f"{kind}-{SHARP}", NEUTRAL, settings)
        white = float(np.percentile(light, _WHITE_PERCENTILE))
        if not white > 0:
            raise UserError(
                f"{record.path}: the picture {kind}-{SHARP} is dark. Expose it longer: the "
                "setting 'sharp_ms'."
            )
        found[kind] = SharpPicture(light / white, white)
    return found


def decode_pictures(
    record: Record,
    brackets: list[Bracket],
    sharp: Mapping[str, SharpPicture],
    settings: EdofSettings,
    progress: Progress,
) -> Pictures:
    """Decode all recorded pictures behind all patterns, and score them.

    Raises UserError if pictures are missing or clipped.
    """
    camera, wavelength = record.camera, settings.wavelength_nm * 1e-9
    prints = [photograph_name(one) for one in settings.distances_m]
    found = {}
    for number, name in enumerate(PATTERNS):
        progress.report(number / len(PATTERNS), f"decoders for {name}")
        grey = torch.from_numpy(record.pattern(name))
        decoders = decoders_of(pattern_in_pupil(name, grey, camera, wavelength), camera, settings)
        for kind, truth in sharp.items():
            targets = prints if kind == PRINT else [OBJECTS]
            taken = [_take_picture(record, brackets, one, name, settings) for one in targets]
            # One filter serves all pictures of a kind: a noise of its own would tell a decoder
            # something of the depth.
            noise = float(np.sqrt(np.mean([variance for _, variance in taken]))) / truth.white
            for target, (light, _) in zip(targets, taken, strict=True):
                image = torch.from_numpy(light / truth.white).to(torch.float32)
                for decoder in decoders:
                    restored = decoder.restore(image, noise).double().numpy()
                    scored = score_picture(restored, truth.image, noise, settings)
                    found[target, name, decoder.label] = scored
    return found


def score_picture(
    image: Picture, truth: Picture, noise: float, settings: EdofSettings
) -> DecodedPicture:
    """Score a picture against what it should be; both have white at 1."""
    side = min(settings.scored_px, *image.shape)
    seen, wanted = (
        centred_crop(torch.from_numpy(np.asarray(one, np.float64)), (side, side))
        for one in (image, truth)
    )
    coded, aim = (encode_srgb(one.clamp(0, 1)) for one in (seen, wanted))
    srgb_psnr, ssim = metrics.psnr(coded, aim), metrics.ssim(coded, aim)
    return DecodedPicture(image, metrics.psnr(seen, wanted), srgb_psnr, ssim, noise)


def _take_picture(
    record: Record, brackets: list[Bracket], target: str, pattern: str, settings: EdofSettings
) -> tuple[Picture, float]:
    """Cut the part that is decoded out of a picture: electrons per second, and mean variance."""
    wavelength = settings.wavelength_nm * 1e-9
    bracket = find_bracket(brackets, target, pattern, wavelength, record.path)
    side = min(settings.frame_px, *bracket.rate.shape)
    light, variance = (
        centred_crop(torch.from_numpy(np.asarray(one, np.float64)), (side, side)).numpy()
        for one in (bracket.rate, bracket.variance)
    )
    known = np.isfinite(variance)
    if not known.all():
        raise UserError(
            f"{record.path}: {int((~known).sum())} pixels of {target} with {pattern} are clipped "
            "in every exposure. Expose it shorter: the settings 'scene_ms' and 'sharp_ms'."
        )
    return light, float(variance.mean())


def labels_of(found: Pictures) -> list[str]:
    """Return the labels of all decoders, in order."""
    return list(dict.fromkeys(label for _, name, label in found if name == DESIGNED))
