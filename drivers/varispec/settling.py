"""How long a VariSpec's liquid crystals need, by their temperature."""

from __future__ import annotations

import math

ZERO_CELSIUS = 273.15
"""0 degrees Celsius, in kelvin."""

COLDEST, WARMEST = 10.0, 40.0
"""Operating temperatures of the optics in degrees Celsius, as specified."""

_NOMINAL = 20.0
"""Degrees Celsius from which on the specified response time holds."""

_ACTIVATION = math.log(2.0) / (1 / (_NOMINAL + ZERO_CELSIUS) - 1 / (35.0 + ZERO_CELSIUS))
"""Kelvin. At 35 degrees the viscosity is half of what it is at 20."""


def settling_factor(temperature: float) -> float:
    """By how much settling takes longer than specified, at degrees Celsius.

    The response time goes with the viscosity of the liquid crystals, which halves from 20 to
    35 degrees (VariSpec user manual 1.37, "Response Time versus Temperature"), taken as
    Arrhenius' law between and beyond. The specified time counts as that at 20 degrees, below
    which the manual says it is longer; that it is shorter above is not made use of.
    """
    cold = 1 / (max(temperature, -ZERO_CELSIUS + 1.0) + ZERO_CELSIUS) - 1 / (
        _NOMINAL + ZERO_CELSIUS
    )
    return max(1.0, math.exp(_ACTIVATION * cold))
