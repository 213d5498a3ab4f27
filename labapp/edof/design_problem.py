"""The problem of designing a pattern that extends a bench's depth of field."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch

from labapp.common.errors import UserError
from labapp.edof.design_request import PIXEL_PARAMETRISATIONS, STARTS, EdofRequest
from labapp.files.design_file import read_design
from labapp.files.picture.colour_picture import read_screen_colours
from optics.camera import Camera, Panel
from optics.edof.depth_bound import rms_transfer_limit
from optics.edof.panel_transfer import (
    ConditionTransfer,
    FullTransfer,
    PanelCondition,
    QuarterTransfer,
    fold_into_range,
)
from optics.edof.parametrisation import PhaseParametrisation, make_parametrisation
from optics.edof.pattern_search import DesignBand
from optics.edof.pattern_transfer import PatternTransfer
from optics.edof.picture_spectrum import (
    NATURAL_SPECTRUM,
    FrequencyGrid,
    SpectrumModel,
    measure_picture_spectrum,
)
from optics.edof.protocol import convert_to_luminance, decode_srgb
from optics.edof.transfer_design import WINDOW_REACH, TransferDesign
from optics.patterns import (
    cubic_phase_mask,
    even_vergences,
    focal_sweep_axicon,
    lattice_focal_lens,
    multi_focus_rings,
)
from optics.psf.chain_collapsed import collapse_to_thin_camera
from optics.slm import grey_to_phase, max_phase

_PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}

_SWEEP_MARGIN = 0.075
"""Share of the range of depths by which a swept focus goes beyond both ends, where its light would
be least. Measured on photographs for 0 to 2 dioptres: better than none."""

_CUBIC_WAVES = 20.0
"""Waves of the cubic start at the longer side's end; of 10, 20 and 40 the best with known depth."""


@dataclass(frozen=True, eq=False)
class EdofProblem:
    """What a pattern is designed for: the camera, the pictures, the noise and the depths.

    camera: as the bench describes it. thin: the same with a thin lens at the panel. natural: the
    power spectrum that pictures have if the request names none.
    """

    request: EdofRequest
    camera: Camera
    natural: SpectrumModel = NATURAL_SPECTRUM

    @cached_property
    def thin(self) -> Camera:
        """The camera with a thin lens at the panel that gives the same PSFs on the axis.

        The stop is that which light from infinity sees.
        """
        return collapse_to_thin_camera(self.camera, math.inf)

    @cached_property
    def parametrisation(self) -> PhaseParametrisation:
        """The way in which the pattern is described to the search."""
        return make_parametrisation(self.request.parametrisation, self.camera.panel.shape)

    @property
    def mirrored(self) -> bool:
        """Whether a quarter of the pattern is designed."""
        return self.parametrisation.mirrored and self._has_quarters

    @property
    def _has_quarters(self) -> bool:
        """Whether the panel has even numbers of rows and columns."""
        return not any(n % 2 for n in self.camera.panel.shape)

    @property
    def depth_range(self) -> tuple[float, float]:
        """The farthest and the nearest depth, dioptres."""
        return self.request.far, self.request.near

    def transfer(self, wavelength: float, *, mirrored: bool | None = None) -> PatternTransfer:
        """Return what computes transfer functions of patterns at a wavelength in metres.

        mirrored: whether the patterns are mirrored; as the designed one by default.
        """
        request, reach = self.request, self.window_reach(wavelength)
        design = TransferDesign(self.thin, wavelength, request.size, request.binning, reach)
        quarter = self.mirrored if mirrored is None else mirrored and self._has_quarters
        return QuarterTransfer(design) if quarter else FullTransfer(design)

    def window_reach(self, wavelength: float) -> int:
        """Return the sensor pixels from the middle of a PSF to the border of its window.

        wavelength: metres. The light of a panel of points repeats beyond one order.
        """
        lens, panel = self.thin.lens, self.thin.panel
        period = wavelength * lens.image_distance / (panel.pitch * self.thin.sensor.pitch)
        return min(WINDOW_REACH, math.floor((period - 1) / 2))

    def phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Return the phase of parameters in the shape that `transfer` takes; differentiable.

        It is unwrapped, or as the panel displays it where the design knows of conditions.
        """
        short = self.mirrored and self.parametrisation.quarter_phase(parameters)
        phase = self.parametrisation.phase(parameters) if short is False else short
        return fold_into_range(phase, self._displayed_top) if self.conditions else phase

    def whole_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Return the phase of parameters on all of the panel's pixels, radians; differentiable."""
        phase = self.parametrisation.phase(parameters)
        return fold_into_range(phase, self._displayed_top) if self.conditions else phase

    @cached_property
    def conditions(self) -> tuple[PanelCondition, ...]:
        """The conditions of the panel that the pattern shall stand, besides none.

        An error of the response comes together with the fringing.
        """
        blur, error = self.fringing, self.request.response_error
        still = (PanelCondition(blur),) if blur else ()
        wrong = (1 - error, 1 + error) if error else ()
        return (*still, *(PanelCondition(blur, one) for one in wrong))

    @property
    def fringing(self) -> float:
        """Standard deviation of the blur by fringing fields that the pattern shall stand, metres.

        Where the request says nothing it is the panel's own, for patterns of pixels.
        """
        if self.request.fringing is not None:
            return self.request.fringing
        by_pixels = self.request.parametrisation in PIXEL_PARAMETRISATIONS
        return self.camera.panel.coupling if by_pixels else 0.0

    @property
    def _displayed_top(self) -> float:
        """Largest displayed phase in radians: a level of the panel below the whole waves in use."""
        panel = self.camera.panel
        level = max_phase(panel, self.request.wavelengths[0]) / (panel.levels - 1)
        return 2 * math.pi * self.request.orders - level

    def further_bands(self) -> tuple[DesignBand, ...]:
        """Return the wavelengths after the first one, and the conditions at all, for the search."""
        count = len(self.request.wavelengths)
        transfers = [self.transfer(one) for one in self.request.wavelengths]
        patterns = [self.phase, *(self.phase_at(band) for band in range(1, count))]
        spectra = [self.spectrum_on(one.grid) for one in transfers]
        found = [DesignBand(transfers[k], spectra[k], patterns[k]) for k in range(1, count)]
        for condition in self.conditions:
            for k in range(count):
                transfer = ConditionTransfer(transfers[k], condition)
                found.append(DesignBand(transfer, spectra[k], patterns[k], filter_of=k))
        return tuple(found)

    def phase_at(self, band: int) -> Callable[[torch.Tensor], torch.Tensor]:
        """Return the function from parameters to the phase at a wavelength after the first one.

        The panel shows the phase for the first wavelength, wrapped to the waves in use; at another
        wavelength the same grey levels give another phase. Derivatives pass the jumps of the
        wrapping by.
        """
        first, other = (
            max_phase(self.camera.panel, self.request.wavelengths[one]) for one in (0, band)
        )
        period = 2 * math.pi * self.request.orders

        def other_phase(parameters: torch.Tensor) -> torch.Tensor:
            return torch.remainder(self.phase(parameters), period) * (other / first)

        return other_phase

    @cached_property
    def spectrum(self) -> torch.Tensor:
        """The pictures' power spectrum on the half of the frequencies, float64."""
        if self.request.pictures is None:
            return self.natural.on_grid(FrequencyGrid(self.request.size))
        return measure_picture_spectrum(_read_pictures(self.request.pictures), self.request.size)

    def spectrum_on(self, grid: FrequencyGrid) -> torch.Tensor:
        """Return the pictures' power spectrum on a grid of frequencies."""
        return grid.select_quarter(self.spectrum) if grid.quarter else self.spectrum

    @property
    def spectrum_source(self) -> str:
        """The source of the pictures' power spectrum, in words."""
        if self.request.pictures is None:
            return self.natural.source
        return str(self.request.pictures)

    def limit(self, wavelength: float) -> torch.Tensor:
        """Return the largest rms transfer function of any pattern on the quarter of frequencies."""
        grid = FrequencyGrid(self.request.size, quarter=True)
        return rms_transfer_limit(self.thin, wavelength, grid, depth_range=self.depth_range)

    def start_phase(self) -> torch.Tensor:
        """Return the phase from which the design starts, (rows, columns), radians.

        It is unwrapped, or as the panel displays it where the design knows of conditions. Raises
        UserError for a file that has no phase for this panel.
        """
        request = self.request
        if request.start not in STARTS:
            phase = _read_phase(Path(request.start), self.camera.panel)
        else:
            phase = self.pattern(request.start, request.wavelengths[0])
        if not self.conditions or (
            float(phase.min()) >= 0 and float(phase.max()) <= 2 * math.pi * request.orders
        ):
            return phase
        # It isn't displayed so yet: it is put into the middle of the range.
        return torch.remainder(phase, 2 * math.pi) + math.pi * (request.orders - 1)

    def pattern(self, name: str, wavelength: float) -> torch.Tensor:
        """Return a hand-made pattern for this camera and range of depths, radians, unwrapped."""
        panel, (far, near) = self.camera.panel, self.depth_range
        focus = 1 / self.thin.lens.focus_distance
        if name == "rings":
            return multi_focus_rings(panel, even_vergences(near, far, 10), wavelength, focus=focus)
        if name == "sweep":
            beyond = _SWEEP_MARGIN * (near - far)
            return focal_sweep_axicon(panel, near + beyond, far - beyond, wavelength, focus=focus)
        if name == "lattice":
            return lattice_focal_lens(panel, near, far, wavelength, focus=focus)
        y, x = panel.plane.mesh()
        middle = math.pi / wavelength * ((near + far) / 2 - focus) * (y**2 + x**2)
        if name == "cubic":
            # The slope is three times the strength at the longer side's end: half a wave per pixel.
            waves = min(_CUBIC_WAVES, 0.9 * max(panel.shape) / 12)
            return cubic_phase_mask(panel, 2 * math.pi * waves) - middle
        return torch.zeros(panel.shape, dtype=torch.float64)


def _read_phase(path: Path, panel: Panel) -> torch.Tensor:
    """Read a design file's phase, to start another design from.

    Of grey levels alone, it is the phase that the bench's panel shows.
    """
    contents = read_design(path)
    rows, columns = contents.grey.shape[1:]
    if (rows, columns) != panel.shape:
        raise UserError(
            f"{path}: is for {columns}x{rows} pixels, and the bench's panel has "
            f"{panel.shape[1]}x{panel.shape[0]}."
        )
    if contents.phase is not None:
        return torch.from_numpy(contents.phase[0]).double()
    return grey_to_phase(panel, torch.from_numpy(contents.grey[0]), contents.wavelength).double()


def _read_pictures(folder: Path) -> Iterator[torch.Tensor]:
    """Yield the luminance of all pictures of a folder in linear light, white at 1."""
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in _PICTURES)
    if not files:
        raise UserError(f"--pictures {folder}: there is no picture in it. Name another folder.")
    for file in files:
        colours = torch.from_numpy(read_screen_colours(file))
        yield convert_to_luminance(decode_srgb(colours / 255.0))
