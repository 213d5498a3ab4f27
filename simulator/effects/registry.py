"""List all effects, in the order in which light meets them."""

from __future__ import annotations

from simulator.effects.band_effects import Bandwidth, Leak
from simulator.effects.depths import DepthLayers, Occlusion
from simulator.effects.diffraction import Diffraction, PSFReach
from simulator.effects.field_effects import FieldAberrations, FieldPosition, Vignetting
from simulator.effects.filter_angle import FilterAngle
from simulator.effects.glare import LensGhosts, VeilingGlare
from simulator.effects.lens_effects import AxialColour, Distortion, FocusDrift, LateralColour
from simulator.effects.panel_effects import (
    Coupling,
    CrystalResponse,
    Flatness,
    Flicker,
    FrontReflection,
    GapLight,
    Illumination,
    Interference,
    Jitter,
    PanelDispersion,
    PanelResponse,
    UnmodulatedLight,
)
from simulator.effects.panel_orders import PanelOrders
from simulator.effects.pixel_effects import (
    ColourFilters,
    Dust,
    PixelAperture,
    PixelCrosstalk,
    Speckle,
)
from simulator.effects.sampling import LightSampling
from simulator.effects.sensor_effects import (
    Clipping,
    DarkCurrent,
    FixedPattern,
    Quantisation,
    ReadNoise,
)
from simulator.effects.shot_noise import ShotNoise
from simulator.effects.time_effects import LampFlicker, Motion, RollingShutter, Vibration
from simulator.planning import Effect

EFFECTS: tuple[Effect, ...] = (
    LampFlicker(),
    Motion(),
    DepthLayers(),
    Occlusion(),
    Speckle(),
    Bandwidth(),
    Leak(),
    FilterAngle(),
    Interference(),
    PanelDispersion(),
    Illumination(),
    FrontReflection(),
    PanelResponse(),
    Coupling(),
    Flicker(),
    Jitter(),
    GapLight(),
    Flatness(),
    CrystalResponse(),
    UnmodulatedLight(),
    PanelOrders(),
    FieldPosition(),
    FieldAberrations(),
    Vignetting(),
    AxialColour(),
    FocusDrift(),
    Diffraction(),
    PSFReach(),
    Vibration(),
    LateralColour(),
    Distortion(),
    LightSampling(),
    PixelAperture(),
    LensGhosts(),
    VeilingGlare(),
    Dust(),
    ColourFilters(),
    PixelCrosstalk(),
    RollingShutter(),
    DarkCurrent(),
    FixedPattern(),
    ShotNoise(),
    Clipping(),
    ReadNoise(),
    Quantisation(),
)
