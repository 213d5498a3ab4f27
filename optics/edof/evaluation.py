"""Evaluate patterns that extend the depth of field by a protocol, beside smaller stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from optics.camera import Camera
from optics.edof.alarms import Alarm, check_energy
from optics.edof.decoders import Decoder
from optics.edof.pattern_evaluation import PatternEvaluation
from optics.edof.picture_preparation import prepare_scene
from optics.edof.protocol import EdofProtocol
from optics.edof.protocol_psfs import CameraPSFs, DepthPSFs, PSFSource, compute_depth_psfs
from optics.edof.pupil_pattern import STOP_DIAMETERS, PupilPattern, round_stop
from optics.edof.score_table import EvaluationTable, ScoreRow
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class MeasuredPattern:
    """Describe a pattern by measured PSFs, at the protocol's depths.

    Parameters
    ----------
    name : str
        Name in tables.
    design : DepthPSFs
        PSFs at the protocol's `design_dioptres`.
    test : DepthPSFs
        PSFs at the protocol's `test_dioptres`.
    """

    name: str
    design: DepthPSFs
    test: DepthPSFs


def prepare_scenes(
    pictures: Sequence[torch.Tensor], protocol: EdofProtocol
) -> tuple[torch.Tensor, ...]:
    """Bring photographs to the size and light of the evaluation protocol's scenes.

    Parameters
    ----------
    pictures : sequence of torch.Tensor
        Photographs in sRGB values, as for `prepare_scene`.
    protocol : EdofProtocol
        The protocol.

    Returns
    -------
    tuple of torch.Tensor, each (scene_side, scene_side)
        The scenes.

    Raises
    ------
    ValueError
        If there is no picture, or one is invalid or too small.
    """
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

    Every pattern sees the same pictures, depths and noise. Stops of STOP_DIAMETERS are always
    evaluated too, with the noise that belongs to their light, because a small stop is the simplest
    way to extend the depth of field.

    Parameters
    ----------
    patterns : sequence of PupilPattern or MeasuredPattern
        What is compared. Names must differ.
    pictures : sequence of torch.Tensor
        Photographs in sRGB values, as for `prepare_scene`. They mustn't have been used for the
        patterns or the decoders.
    camera : Camera
        The camera.
    protocol : EdofProtocol
        The protocol.
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
            test = _with_expected_energies(test, pattern, camera, protocol, own)
    alarms = [check_energy(design), check_energy(test)]
    return design, test, [one for one in alarms if one is not None][:1]


def _with_expected_energies(
    psfs: DepthPSFs,
    pattern: PupilPattern,
    camera: Camera,
    protocol: EdofProtocol,
    own: CameraPSFs,
) -> DepthPSFs:
    """Note which energy a source's PSFs should have, at the depth that is farthest from focus.

    All other energies are taken as they are.
    """
    focus = 1 / float(camera.lens.focus_distance)
    depth = max(range(len(psfs.dioptres)), key=lambda k: abs(psfs.dioptres[k] - focus))
    expected = list(psfs.energies)
    farthest = psfs.dioptres[depth : depth + 1]
    check = compute_depth_psfs(pattern, farthest, camera, protocol, own)
    expected[depth] = check.energies[0]
    return replace(psfs, expected_energies=tuple(expected))


def _require_unique(name: str, names: Sequence[str]) -> None:
    """Raise ValueError unless what is evaluated has different names, at least one."""
    if not names:
        raise ValueError(f"{name} is empty; give one at least")
    for one in names:
        if names.count(one) > 1:
            raise ValueError(f"{name} has {one!r} more than once; give different names")
