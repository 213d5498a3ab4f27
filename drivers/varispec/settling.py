"""How settling depends on the temperature of the liquid crystals."""

from __future__ import annotations

import math

ZERO_CELSIUS = 273.15
"""0 degrees Celsius, in kelvin."""

COLDEST, WARMEST = 10.0, 40.0
"""Operating temperatures of the optics in degrees Celsius, as specified."""

_NOMINAL = 20.0
"""Degrees Celsius above which the specified response time holds."""

_ACTIVATION = math.log(2.0) / (1 / (_NOMINAL + ZERO_CELSIUS) - 1 / (35.0 + ZERO_CELSIUS))
"""Activation temperature in kelvin: at 35 degrees Celsius the viscosity is half that at 20."""


def settling_factor(temperature: float) -> float:
    """Return the ratio of the settling time to the specified one, at degrees Celsius.

    The response time is proportional to the viscosity of the liquid crystals, which halves from
    20 to 35 degrees (VariSpec user manual 1.37, "Response Time versus Temperature"). Between and
    beyond these temperatures, Arrhenius' law is used. The specified time is taken as that at 20
    degrees, below which the manual says it is longer. The shorter time above is not used.
    """
    cold = 1 / (max(temperature, -ZERO_CELSIUS + 1.0) + ZERO_CELSIUS) - 1 / (
        _NOMINAL + ZERO_CELSIUS
    )
    return max(1.0, math.exp(_ACTIVATION * cold))
