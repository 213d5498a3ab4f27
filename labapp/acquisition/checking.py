"""Whether a bench can do what a plan asks, and what it will take, before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points

from labapp.acquisition.abilities import Abilities
from labapp.acquisition.hooks import GROUP
from labapp.acquisition.steps import Shot, exposures
from labapp.errors import UserError
from labapp.files.plan_file import Acquisition, PlanFile

_FRAME_ROW = 128
"""Bytes that a record keeps of a frame beside its picture, and of its log."""

_RECORD = 1_000_000
"""Bytes of a record without a frame, at most."""

_CUT = 1e-3
"""Share of a video's frame by which an exposure may miss the end of its period."""


@dataclass(frozen=True)
class Expected:
    """What a run will take: frames, seconds of bench time, bytes, and acts of a person."""

    frames: int
    seconds: float
    disk_bytes: int
    prompts: tuple[str, ...]


def expect(listed: Sequence[Shot], plan: PlanFile, abilities: Abilities) -> Expected:
    rows, columns = abilities.frame_shape
    shown = sum(getattr(pattern, "length", 1) for pattern in plan.patterns.values())
    size = len(listed) * (2 * rows * columns + _FRAME_ROW)
    size += shown * abilities.panel_shape[0] * abilities.panel_shape[1] + _RECORD
    return Expected(
        frames=len(listed),
        seconds=sum(shot.lasts for shot in listed),
        disk_bytes=size,
        prompts=tuple(prompts(listed, abilities)),
    )


def prompts(listed: Sequence[Shot], abilities: Abilities) -> list[str]:
    """What a person will be asked, in order: once whenever another target is placed."""
    asked = []
    placed = ""
    for shot in listed:
        if shot.target != placed and (text := prompt(shot, abilities.by_hand)):
            asked.append(text)
        placed = shot.target
    return asked


def prompt(shot: Shot, by_hand: bool) -> str:
    """What a person does before a frame's target is placed; empty if the bench does it."""
    return shot.prompt or (f"Place {shot.place}, then press Enter." if by_hand else "")


def check(plan: PlanFile, abilities: Abilities, source: str) -> None:
    """UserError if the plan asks for what the bench can't do; names key, value and range."""
    _check_hooks(plan, source)
    for number, block in enumerate(plan.acquire):
        where = f"{source}: key 'acquire.{number}"
        _check_targets(block, plan, abilities, where)
        _check_wavelengths(block, abilities, where)
        _check_exposures(block, plan, abilities, where)


def _check_hooks(plan: PlanFile, source: str) -> None:
    known = entry_points(group=GROUP).names
    for name in plan.hooks:
        if name not in known:
            raise UserError(
                f"{source}: key 'hooks' names {name!r}, which isn't installed. "
                f"Installed: {', '.join(sorted(known)) or 'none'}."
            )


def _check_targets(block: Acquisition, plan: PlanFile, abilities: Abilities, where: str) -> None:
    calibration = [one.target or one.role for one in block.interleave if one.role != "neutral"]
    for name in (*block.targets, *calibration):
        known = plan.targets.get(name)
        if ((known.place if known else None) or name) not in abilities.targets:
            raise UserError(
                f"{where}.targets' names {name!r}, which this bench doesn't have. "
                f"Choose among {', '.join(abilities.targets)}."
            )


def _check_wavelengths(block: Acquisition, abilities: Abilities, where: str) -> None:
    shortest, longest = abilities.wavelength_range
    for slot in block.slots or ():
        if slot > len(abilities.slots):
            have = f"1 to {len(abilities.slots)}" if abilities.slots else "wavelengths_nm instead"
            raise UserError(
                f"{where}.slots' has {slot}, and this bench's filter has "
                f"{len(abilities.slots) or 'no'} slots. Choose {have}."
            )
    for nm in block.wavelengths_nm or ():
        metres = round(nm * 1e3) * 1e-12
        if not shortest <= metres <= longest:
            raise UserError(
                f"{where}.wavelengths_nm' has {nm:g}, out of the filter's range. "
                f"Choose {shortest * 1e9:.0f} to {longest * 1e9:.0f} nm."
            )
        if abilities.slots and all(abs(metres - centre) > 1e-12 for centre in abilities.slots):
            listed = ", ".join(f"{centre * 1e9:g}" for centre in abilities.slots)
            raise UserError(
                f"{where}.wavelengths_nm' has {nm:g}, and no slot of the filter wheel passes it. "
                f"Choose among {listed} nm."
            )


def _check_exposures(block: Acquisition, plan: PlanFile, abilities: Abilities, where: str) -> None:
    low, high = abilities.exposure_range
    key = "periods" if block.exposures_ms is None else "exposures_ms"
    for seconds in exposures(block, plan, abilities):
        if not low <= seconds <= high:
            raise UserError(
                f"{where}.{key}' has {seconds * 1e3:g} ms, out of the camera's range. "
                f"Choose {low * 1e3:g} to {high * 1e3:g} ms."
            )
        for name, video in plan.videos(block).items():
            period = video.length * abilities.video_frame
            rest = abs(seconds - max(1, round(seconds / period)) * period)
            if rest > _CUT * abilities.video_frame and not block.any_exposure:
                raise UserError(
                    f"{where}.{key}' has {seconds * 1e3:g} ms, which cuts the video {name!r} "
                    f"within its period of {period * 1e3:.3f} ms. Ask for 'periods' instead, "
                    "or set any_exposure = true."
                )
