"""List all effects, in the order in which light meets them."""

from __future__ import annotations

from simulator.effects.band_effects import Bandwidth, Leak
from simulator.effects.crosstalk import PixelCrosstalk
from simulator.effects.crystal import CrystalResponse
from simulator.effects.depths import DepthLayers
from simulator.effects.diffraction import Diffraction
from simulator.effects.dust import Dust
from simulator.effects.field_aberrations import FieldAberrations
from simulator.effects.field_effects import FieldPosition, Vignetting
from simulator.effects.filter_angle import FilterAngle
from simulator.effects.focus_effects import AxialColour, FocusDrift
from simulator.effects.glare import VeilingGlare
from simulator.effects.image_place import Distortion, LateralColour
from simulator.effects.interference import Interference
from simulator.effects.lens_ghosts import LensGhosts
from simulator.effects.mosaic import ColourFilters
from simulator.effects.moving import Motion, Occlusion
from simulator.effects.panel_effects import (
    Coupling,
    Flatness,
    Flicker,
    FrontReflection,
    GapLight,
    Illumination,
    Jitter,
    PanelDispersion,
    PanelResponse,
    UnmodulatedLight,
)
from simulator.effects.panel_orders import PanelOrders
from simulator.effects.pixel_aperture import PixelAperture
from simulator.effects.reach import PSFReach
from simulator.effects.sampling import LightSampling
from simulator.effects.sensor_effects import (
    Clipping,
    DarkCurrent,
    FixedPattern,
    Quantisation,
    ReadNoise,
)
from simulator.effects.shot_noise import ShotNoise
from simulator.effects.speckle import Speckle
from simulator.effects.time_effects import LampFlicker, RollingShutter
from simulator.effects.vibration import Vibration
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
