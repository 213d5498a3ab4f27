"""Check whether a bench can execute a plan, and estimate its time and disk space beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from math import prod
from typing import TYPE_CHECKING

from labapp.common.errors import UserError
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.runs.acquisition.hooks import HOOK_GROUP
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.readouts import largest_shape
from labapp.runs.record.layout import (
    CHAIN_ROW,
    LOG_ROW,
    MEASURED,
    PLANNED,
    chain_capacity,
    log_capacity,
)
from labapp.runs.record.second_copy import APART
from labapp.runs.shots import Shot, ShotList
from labapp.runs.steps import block_exposures, planned_shots

if TYPE_CHECKING:
    from optics.camera import Sensor

_FRAME_ROW = sum(kind.itemsize for kind in (*PLANNED.values(), *MEASURED.values()))
"""Bytes in a record for each frame's columns, without its picture."""

_DECISIONS = 12_000
"""Largest size in bytes of the effect plan of one picture in a record."""


@dataclass(frozen=True)
class RunEstimate:
    """What a plan takes: frames, seconds of bench time, bytes of its record, and prompts."""

    frames: int
    seconds: float
    disk_bytes: int
    prompts: tuple[str, ...]


def estimate_run(
    shots: Sequence[Shot], plan: PlanFile, capabilities: BenchCapabilities
) -> RunEstimate:
    """Estimate frames, time, disk space and prompts of a plan.

    Disk space is that of the finished record, estimated a little too high.
    """
    listed, count = ShotList.of(shots), len(shots)
    picture = prod(largest_shape(listed.readouts, capabilities.frame_shape))
    shown = sum(getattr(pattern, "length", 1) for pattern in plan.patterns.values())
    twice = (
        count * _FRAME_ROW
        + chain_capacity(count) * CHAIN_ROW.itemsize
        + len(plan.model_dump_json())
        + len(listed.distinct_pictures()) * _DECISIONS
        # Bench, scene and HDF5's own data take less than this.
        + 100_000
    )
    log = log_capacity(count) * LOG_ROW.itemsize
    once = count * 2 * picture + shown * prod(capabilities.panel_shape) + log
    return RunEstimate(
        frames=count,
        seconds=listed.total_duration,
        # The copy of what stands twice lies apart from it.
        disk_bytes=2 * twice + max(once, APART),
        prompts=tuple(prompts_by_frame(listed, capabilities).values()),
    )


def longest_estimate(estimates: Sequence[RunEstimate]) -> RunEstimate:
    """Return the most of each that any of several estimates has."""
    return RunEstimate(
        frames=max(one.frames for one in estimates),
        seconds=max(one.seconds for one in estimates),
        disk_bytes=max(one.disk_bytes for one in estimates),
        prompts=max((one.prompts for one in estimates), key=len),
    )


def expected_plan(
    plan: PlanFile, capabilities: BenchCapabilities, sensor: Sensor, source: str
) -> PlanFile:
    """Settle a plan's brackets for the brightest light, which makes it the shortest.

    Without brackets it is the plan itself. Raises UserError if no light makes a bracket possible.
    """
    if not plan.has_brackets:
        return plan
    # What searches for brackets is loaded only where there are any.
    from labapp.runs.brackets.choice import brightest_plan

    return brightest_plan(plan, capabilities, sensor, source)


def prompts_by_frame(shots: Sequence[Shot], capabilities: BenchCapabilities) -> dict[int, str]:
    """Return the prompts by the index of the frame that waits for the answer, in order.

    Only a frame whose target differs from the last frame's can have a prompt.
    """
    asked: dict[int, str] = {}
    if not any(one.prompt or capabilities.by_hand for one in ShotList.of(shots).targets):
        return asked
    placed = ""
    for shot in shots:
        if shot.target != placed and (text := placement_prompt(shot, capabilities.by_hand)):
            asked[shot.index] = text
        placed = shot.target
    return asked


def placement_prompt(shot: Shot, by_hand: bool) -> str:
    """Return the prompt to place a shot's target; empty if the bench places it."""
    return shot.prompt or (f"Place {shot.place}, then press Enter." if by_hand else "")


def require_feasible_plan(plan: PlanFile, capabilities: BenchCapabilities, source: str) -> None:
    """Raise UserError with key, value and range if the bench can't execute a plan."""
    known = entry_points(group=HOOK_GROUP).names if plan.hooks else set()
    for name in plan.hooks:
        if name not in known:
            raise UserError(
                f"{source}: key 'hooks' names {name!r}, which isn't installed. "
                f"Installed: {', '.join(sorted(known)) or 'none'}."
            )
    for number, block in enumerate(plan.acquire):
        where = f"{source}: key 'acquire.{number}"
        _check_targets(block, plan, capabilities, where)
        _check_wavelengths(block, capabilities, where)
        _check_exposures(block, plan, capabilities, where)
        _check_readouts(block, capabilities, where)


def feasible_shots(plan: PlanFile, capabilities: BenchCapabilities, source: str) -> ShotList:
    """Return every shot of a plan, after require_feasible_plan() has checked it."""
    require_feasible_plan(plan, capabilities, source)
    return planned_shots(plan, capabilities)


def _check_targets(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, where: str
) -> None:
    calibration = [one.target or one.role for one in block.interleave if one.role != "neutral"]
    for key, names in (("targets", block.targets), ("interleave", calibration)):
        for name in names:
            known = plan.targets.get(name)
            if ((known.place if known else None) or name) not in capabilities.targets:
                raise UserError(
                    f"{where}.{key}' names {name!r}, which this bench doesn't have. "
                    f"Choose among {', '.join(capabilities.targets)}."
                )


def _check_wavelengths(block: Acquisition, capabilities: BenchCapabilities, where: str) -> None:
    shortest, longest = capabilities.wavelength_range
    for slot in block.slots or ():
        if slot > len(capabilities.slots):
            have = (
                f"1 to {len(capabilities.slots)}"
                if capabilities.slots
                else "wavelengths_nm instead"
            )
            raise UserError(
                f"{where}.slots' has {slot}, and this bench's filter has "
                f"{len(capabilities.slots) or 'no'} slots. Choose {have}."
            )
    for nm in block.wavelengths_nm or ():
        metres = capabilities.wavelength_in_metres(nm)
        if not shortest <= metres <= longest:
            raise UserError(
                f"{where}.wavelengths_nm' has {nm:g}, out of the filter's range. "
                f"Choose {shortest * 1e9:.0f} to {longest * 1e9:.0f} nm."
            )
        if capabilities.slots and all(
            abs(metres - centre) > 1e-12 for centre in capabilities.slots
        ):
            listed = ", ".join(f"{centre * 1e9:g}" for centre in dict.fromkeys(capabilities.slots))
            raise UserError(
                f"{where}.wavelengths_nm' has {nm:g}, and no slot of the filter wheel passes it. "
                f"Choose among {listed} nm."
            )


def _check_readouts(block: Acquisition, capabilities: BenchCapabilities, where: str) -> None:
    """Raise UserError if the bench's camera can't be read as a block asks."""
    gains = capabilities.gain_range
    if block.gains_db and gains is None:
        raise UserError(
            f"{where}.gains_db': this bench's camera has no gain in decibels that a plan may set. "
            "Leave it out."
        )
    for gain in block.gains_db or ():
        if gains is not None and not gains[0] <= gain <= gains[1]:
            raise UserError(
                f"{where}.gains_db' has {gain:g}, out of the camera's range. "
                f"Choose {gains[0]:g} to {gains[1]:g} dB."
            )
    for name in ("regions_px", "binnings"):
        if getattr(block, name) and not capabilities.has_regions:
            raise UserError(
                f"{where}.{name}': this bench's camera has no regions and binnings that a plan may "
                "set. Leave it out."
            )
    down, across = capabilities.mosaic
    if down * across > 1 and any(binning > 1 for binning in block.binnings or ()):
        raise UserError(
            f"{where}.binnings' would mix the colours of this sensor's filters. Leave it out."
        )
    rows, columns = capabilities.frame_shape
    for x, y, width, height in block.regions_px or ():
        if x % across or y % down:
            raise UserError(
                f"{where}.regions_px' has {[x, y, width, height]}; with this sensor's colour "
                f"filters, x must be a multiple of {across} and y of {down}."
            )
        if x + width > columns or y + height > rows:
            raise UserError(
                f"{where}.regions_px' has {[x, y, width, height]}, and the camera's frames have "
                f"{columns} x {rows} pixels. Give x, y, width and height within them."
            )
    for binning in block.binnings or ():
        for sides in block.regions_px or ((columns, rows),):
            if binning > min(sides[-2:]):
                raise UserError(
                    f"{where}.binnings' has {binning}, more than the {sides[-2]} x {sides[-1]} "
                    "pixels that are read. Choose fewer."
                )
            if block.regions_px and any(side % binning for side in sides):
                raise UserError(
                    f"{where}.regions_px' has {list(sides)}, and with binning {binning} all four "
                    f"must be multiples of {binning}."
                )


def _check_exposures(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, where: str
) -> None:
    low, high = capabilities.exposure_range
    lasting = block_exposures(block, plan, capabilities)
    asked = [f"exposures_ms' has {ms:g} ms" for ms in block.exposures_ms or ()] or [
        f"periods' has {number}, which last {seconds * 1e3:g} ms"
        for number, seconds in zip(block.periods or (), lasting, strict=True)
    ]
    for said, seconds in zip(asked, lasting, strict=True):
        if not low <= seconds <= high:
            raise UserError(
                f"{where}.{said}, out of the camera's range. "
                f"Choose {low * 1e3:g} to {high * 1e3:g} ms."
            )
        for name, video in plan.videos(block).items():
            period = video.length * capabilities.video_frame
            rest = abs(seconds - max(1, round(seconds / period)) * period)
            # An exposure may miss the end of its period by 0.1 % of a video's frame.
            if rest > 1e-3 * capabilities.video_frame and not block.any_exposure:
                raise UserError(
                    f"{where}.{said}, which cuts the video {name!r} within its period of "
                    f"{period * 1e3:.3f} ms. Ask for 'periods' instead, "
                    "or set any_exposure = true."
                )
