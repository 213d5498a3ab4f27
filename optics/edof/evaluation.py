"""Evaluate patterns on pictures by a protocol, beside smaller stops."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from optics.camera import Camera
from optics.edof.decoders import BlindDecoder, Decoder, Restore, decoding_period, decoding_transfers
from optics.edof.protocol import EdofProtocol, LightScale, prepare_scene
from optics.edof.protocol_psfs import (
    STOP_DIAMETERS,
    CameraPSFs,
    DepthPSFs,
    PSFSource,
    PupilPattern,
    compute_depth_psfs,
    compute_transfer,
    round_stop,
)
from optics.edof.scoring import (
    PARTS,
    Alarm,
    CaptureScores,
    EvaluationTable,
    Part,
    ScoreRow,
    check_energy,
    check_off_grid,
    check_repeatability,
    score_picture,
)
from optics.edof.spectral_criterion import noise_at_light
from optics.fourier import fast_fft_length, irfft2, rfft2
from optics.plane import centred_crop, centred_pad
from optics.progress import Progress
from optics.validation import require_positive


class SceneBlur:
    """Computes noiseless images of scenes through one PSF, on the pixels of captures.

    The protocol says whether the image wraps around the crop, or takes in light from beyond it.
    Raises ValueError if the PSF reaches farther than the protocol's window.

    kernel: PSF on detector pixels, (rows, columns), origin at n // 2.
    """

    def __init__(self, kernel: torch.Tensor, protocol: EdofProtocol) -> None:
        self._side, self._crop = protocol.scene_side, protocol.crop
        reach = max(n // 2 for n in kernel.shape)
        if protocol.border == "true" and reach > protocol.kernel_reach:
            raise ValueError(
                f"kernel reaches {reach} pixels; the protocol's window allows "
                f"{protocol.kernel_reach}"
            )
        self._border = protocol.border
        period = self._side if self._border == "periodic" else fast_fft_length(self._side)
        self._shape = (period, period)
        self._transfer = compute_transfer(kernel, self._shape)

    def __call__(self, scene: torch.Tensor) -> torch.Tensor:
        """Compute the noiseless image (crop, crop) of a scene of the protocol's `scene_side`."""
        if tuple(scene.shape) != (self._side, self._side):
            raise ValueError(
                f"scene is {tuple(scene.shape)}; with a {self._border} border and a crop of "
                f"{self._crop} the protocol needs {self._side} x {self._side}"
            )
        # With a true border, what wraps around stays in the margin, as wide as the PSF's reach.
        spectrum = rfft2(centred_pad(scene, self._shape)) * self._transfer
        return centred_crop(irfft2(spectrum, self._shape), (self._crop, self._crop))


def add_noise(
    image: torch.Tensor,
    deviation: float,
    collected: float,
    generator: torch.Generator,
    shot_share: float = 0.0,
) -> torch.Tensor:
    """Add the noise of a capture to an image, more of it where less light is collected.

    The capture is scaled up to the brightness of one with the full aperture. With the share T of
    the light, read noise therefore has the standard deviation `deviation` / T, and photon noise has
    the variance of the full aperture's over T. The capture isn't clipped. Raises ValueError if a
    number is out of range.

    image: noiseless image relative to the collected light, (rows, columns): white is 1.
    deviation: standard deviation of a white pixel with the full aperture.
    collected: share T of the open pupil's light.
    shot_share: share of a white pixel's variance with the full aperture that is photon noise, 0 to
        1. It is Gaussian here, with a variance proportional to the light.
    """
    require_positive("deviation", deviation, "")
    white = noise_at_light(deviation, collected, shot_share)
    normal = torch.randn(image.shape, generator=generator, dtype=torch.float32).to(image)
    if not shot_share:
        return image + white * normal
    read = noise_at_light(deviation * math.sqrt(1 - shot_share), collected)
    shot_variance = (white**2 - read**2) * image.clamp(min=0.0)
    variance = read**2 + shot_variance
    # Photons alone leave darkness without noise, where the root has no finite slope.
    noisy = variance > 0
    deviations = torch.where(noisy, variance, 1.0).sqrt()
    return image + torch.where(noisy, deviations, 0.0) * normal


class PatternEvaluation:
    """Captures all scenes behind one pattern at all depths, and scores what decoders restore.

    design, test: the pattern's PSFs at the protocol's depths of design and of test.
    scenes: scenes of the protocol's size and light.
    """

    def __init__(
        self,
        design: DepthPSFs,
        test: DepthPSFs,
        scenes: Sequence[torch.Tensor],
        protocol: EdofProtocol,
        with_ssim: bool,
    ) -> None:
        self._test, self._scenes, self._protocol = test, scenes, protocol
        self._with_ssim = with_ssim
        crop = (protocol.crop, protocol.crop)
        self._references = [centred_crop(one, crop) for one in scenes]
        self._design = decoding_transfers(design, protocol)
        self._period = decoding_period(protocol)
        self._levels = [
            noise_at_light(one, test.collected, protocol.noise.shot_share)
            for one in protocol.noise.deviations
        ]

    def rows(
        self, pattern: str, decoder: Decoder, alarms: Sequence[Alarm], progress: Progress
    ) -> list[ScoreRow]:
        """Restore all captures by a decoder, and return the rows of their scores."""
        protocol, test = self._protocol, self._test
        kinds = [(scale, part) for scale in protocol.scored_in for part in PARTS]
        psnr, ssim, repeated = self._score(decoder, kinds, progress)
        found = []
        for (scale, part), levels, similarities in zip(kinds, psnr, ssim, strict=True):
            scores = CaptureScores(test.dioptres, len(protocol.on_grid), levels, similarities)
            raised = [one for one in (repeated, check_off_grid(scores)) if one is not None]
            found.append(
                ScoreRow(
                    pattern,
                    decoder.name,
                    isinstance(decoder, BlindDecoder),
                    protocol,
                    scale,
                    part,
                    test.collected,
                    (min(test.energies), max(test.energies)),
                    scores,
                    (*alarms, *raised),
                )
            )
        return found

    def _score(
        self, decoder: Decoder, kinds: Sequence[tuple[LightScale, Part]], progress: Progress
    ) -> tuple[torch.Tensor, torch.Tensor, Alarm | None]:
        """Return PSNR and SSIM, (kinds, pictures, depths), and whether the decoder is repeatable.

        Depths come in random order, which tells a decoder nothing.
        """
        shape = (len(kinds), len(self._scenes), len(self._test.dioptres))
        psnr = torch.zeros(shape, dtype=torch.float64)
        ssim = psnr.new_zeros(shape if self._with_ssim else (*shape[:2], 0))
        # A blind decoder is built before anything is captured.
        blind = isinstance(decoder, BlindDecoder)
        built = [decoder.build(self._design, level) for level in self._levels] if blind else []
        first: tuple[Restore, torch.Tensor, torch.Tensor] | None = None
        generator = torch.Generator().manual_seed(self._protocol.seed)
        for depth in torch.randperm(shape[2], generator=generator).tolist():
            progress.raise_if_cancelled()
            blur = SceneBlur(self._test.kernels[depth], self._protocol)
            if not blind:
                transfer = compute_transfer(self._test.kernels[depth], self._period)
                built = [decoder.build(transfer, level) for level in self._levels]
            for picture, reference in enumerate(self._references):
                # A picture has the same noise level at all depths, so that these can be compared.
                level = picture % len(self._levels)
                capture = self._capture(blur, picture, depth, level)
                restored = built[level](capture.clone())
                first = first or (built[level], capture, restored.clone())
                for kind, (scale, part) in enumerate(kinds):
                    psnr[kind, picture, depth], similarity = score_picture(
                        restored, reference, self._protocol, scale, part, with_ssim=self._with_ssim
                    )
                    if similarity is not None:
                        ssim[kind, picture, depth] = similarity
        assert first is not None
        return psnr, ssim, check_repeatability(*first)

    def _capture(self, blur: SceneBlur, picture: int, depth: int, level: int) -> torch.Tensor:
        """Capture a scene at a depth, with noise that is the same for every pattern."""
        noise = self._protocol.noise
        seed = (self._protocol.seed * 10_007 + picture) * 10_007 + depth
        return add_noise(
            blur(self._scenes[picture]),
            noise.deviations[level],
            self._test.collected,
            torch.Generator().manual_seed(seed),
            noise.shot_share,
        )


@dataclass(frozen=True, eq=False)
class MeasuredPattern:
    """A pattern that is known by its measured PSFs, at the protocol's depths of design and test."""

    name: str
    design: DepthPSFs
    test: DepthPSFs


def prepare_scenes(
    pictures: Sequence[torch.Tensor], protocol: EdofProtocol
) -> tuple[torch.Tensor, ...]:
    """Bring photographs to scenes of a protocol's size and light; see `prepare_scene`."""
    if not len(pictures):
        raise ValueError("pictures is empty; give one at least")
    return tuple(
        prepare_scene(
            torch.as_tensor(one), protocol.scene_side, protocol.light, protocol.shortest_edge
        )
        for one in pictures
    )


def evaluate_patterns(
    patterns: Sequence[PupilPattern | MeasuredPattern],
    pictures: Sequence[torch.Tensor],
    camera: Camera,
    protocol: EdofProtocol,
    decoders: Sequence[Decoder],
    *,
    source: PSFSource | None = None,
    known_alarms: Mapping[str, Sequence[Alarm]] | None = None,
    with_ssim: bool = True,
    progress: Progress | None = None,
) -> EvaluationTable:
    """Evaluate patterns and round stops with some decoders, on pictures, by a protocol.

    Every pattern sees the same pictures, depths and noise. Stops of STOP_DIAMETERS are evaluated
    too, with the noise that belongs to their light: they extend the depth of field most simply.

    Parameters
    ----------
    patterns : sequence of PupilPattern or MeasuredPattern
        What is compared. Names must differ.
    pictures : sequence of torch.Tensor
        Photographs in sRGB values, as for `prepare_scene`. They mustn't have been used for the
        patterns or the decoders.
    camera : Camera
        What stands behind the patterns.
    protocol : EdofProtocol
        How they are evaluated.
    decoders : sequence of BlindDecoder or KnownDepthDecoder
        What restores the captures.
    source : callable, optional
        Computes the PSFs; by default `CameraPSFs`. The energy of another source's PSFs is compared
        with that of `CameraPSFs` at one depth.
    known_alarms : mapping of str to sequence of Alarm, optional
        Alarms by name of pattern or decoder that were raised before, such as that of
        `check_sampler` for the sampler of a training.
    with_ssim : bool, default True
        Whether the SSIM is computed.
    progress : Progress, optional
        Reports, and cancels.

    Returns
    -------
    EvaluationTable
        One row for each pattern, decoder, scale and part.

    Raises
    ------
    ValueError
        If names aren't unique, something is empty, or a picture or pattern is invalid.
    """
    stops = [round_stop(camera.panel, diameter) for diameter in STOP_DIAMETERS]
    compared = [*patterns, *stops]
    _require_unique("patterns", [one.name for one in compared])
    _require_unique("decoders", [one.name for one in decoders])
    scenes = prepare_scenes(pictures, protocol)
    progress, known = progress or Progress(), known_alarms or {}
    own = CameraPSFs(camera, protocol)
    rows: list[ScoreRow] = []
    steps = len(compared) * (1 + len(decoders))
    for number, pattern in enumerate(compared):
        done = number * (1 + len(decoders))
        progress.report(done / steps, f"PSFs of {pattern.name}")
        design, test, alarms = _pattern_psfs(pattern, camera, protocol, own, source)
        run = PatternEvaluation(design, test, scenes, protocol, with_ssim)
        for index, decoder in enumerate(decoders):
            progress.report((done + 1 + index) / steps, f"{pattern.name} with {decoder.name}")
            raised = [*alarms, *known.get(pattern.name, ()), *known.get(decoder.name, ())]
            rows += run.rows(pattern.name, decoder, raised, progress)
    progress.report(1.0)
    return EvaluationTable(protocol, tuple(rows))


def _pattern_psfs(
    pattern: PupilPattern | MeasuredPattern,
    camera: Camera,
    protocol: EdofProtocol,
    own: CameraPSFs,
    source: PSFSource | None,
) -> tuple[DepthPSFs, DepthPSFs, list[Alarm]]:
    """Return a pattern's PSFs at the depths of design and of test, and the alarms they raise."""
    if isinstance(pattern, MeasuredPattern):
        design, test = pattern.design, pattern.test
        for name, psfs, wanted in (
            ("design", design, protocol.design_dioptres),
            ("test", test, protocol.test_dioptres),
        ):
            if psfs.dioptres != wanted:
                raise ValueError(
                    f"{name} PSFs of {pattern.name} are for {len(psfs.dioptres)} depths that aren't"
                    f" the protocol's {len(wanted)}; measure at its {name}_dioptres"
                )
    else:
        used = source or own
        design = compute_depth_psfs(pattern, protocol.design_dioptres, camera, protocol, used)
        test = compute_depth_psfs(pattern, protocol.test_dioptres, camera, protocol, used)
        if source is not None:
            # Which energy a source's PSF should have is known at the depth farthest from focus,
            # where it is computed again; all others are taken as they are.
            focus, depths = 1 / float(camera.lens.focus_distance), test.dioptres
            farthest = max(range(len(depths)), key=lambda k: abs(depths[k] - focus))
            check = compute_depth_psfs(pattern, (depths[farthest],), camera, protocol, own)
            expected = list(test.energies)
            expected[farthest] = check.energies[0]
            test = replace(test, expected_energies=tuple(expected))
    alarms = [check_energy(design), check_energy(test)]
    return design, test, [one for one in alarms if one is not None][:1]


def _require_unique(name: str, names: Sequence[str]) -> None:
    """Raise ValueError unless there are names, and all differ."""
    if not names:
        raise ValueError(f"{name} is empty; give one at least")
    for one in names:
        if names.count(one) > 1:
            raise ValueError(f"{name} has {one!r} more than once; give different names")
