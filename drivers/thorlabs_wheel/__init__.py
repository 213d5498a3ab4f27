"""Drive Thorlabs' filter wheels FW102C and FW212C."""

from drivers.thorlabs_wheel.wheel import ThorlabsWheel

__all__ = ["ThorlabsWheel"]
