"""Settle a plan's brackets for the brightest light, before anything is known of a run's scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labapp.files.plan_file import PlanFile
from labapp.runs.capabilities import BenchCapabilities

if TYPE_CHECKING:
    from optics.camera import Sensor


def expected_plan(
    plan: PlanFile, capabilities: BenchCapabilities, sensor: Sensor, source: str
) -> PlanFile:
    """Return a run's plan with its brackets settled for the brightest light, the shortest of all.

    Without brackets it is the plan itself. Raises UserError if no light makes a bracket possible.
    """
    if not plan.has_brackets:
        return plan
    # What searches for brackets is loaded only where there are any.
    from labapp.runs.brackets.extremes import brightest_plan

    return brightest_plan(plan, capabilities, sensor, source)
