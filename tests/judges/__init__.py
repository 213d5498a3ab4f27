"""Slow judges that share nothing with the code they judge but the declared model.

The model (thesis Eq. 3.1 and 3.2): a point's field at a place s on the sensor is

    U(s) = integral over the open pupil of exp(2 pi i (path(r) / wavelength - r s / scale)),

scale = wavelength x image distance, and |U|² / (scale² x open area) is its share of the light
per square metre. Phases are made in extended precision, as whole and broken turns, by the
formulas of the textbooks; no judge reduces, folds, interpolates or chooses.
"""

from collections.abc import Callable

from judges.basics import binned as binned
from judges.basics import gaussian_psf as gaussian_psf
from judges.basics import natural_image as natural_image
from judges.basics import positions as positions
from judges.basics import relative as relative
from judges.chain import Apart as Apart
from judges.chain import by_chain as by_chain
from judges.free_space import Beam as Beam
from judges.free_space import Edges as Edges
from judges.free_space import direct_field as direct_field
from judges.lens import by_airy as by_airy
from judges.lens import by_edges as by_edges
from judges.lens import by_fresnel as by_fresnel
from judges.lens import by_lines as by_lines
from judges.lens import by_rings as by_rings
from judges.lommel import by_lommel as by_lommel
from judges.panel import by_panel as by_panel
from judges.panel_sums import line_density as line_density
from judges.panel_sums import line_share as line_share
from judges.panel_sums import quadrature_psf as quadrature_psf
from judges.stops import covered as covered
from judges.stops import open_area as open_area
from judges.stops import scan_lines as scan_lines
from judges.sums import Array
from judges.sums import gauss as gauss
from judges.sums import richardson as richardson
from judges.transforms import direct_transform as direct_transform
from judges.view import View as View
from judges.wave import explicit_zernike as explicit_zernike

Judge = Callable[[View], Array]
