"""Slow judges that share nothing with the code they judge but the declared model.

The model (thesis Eq. 3.1 and 3.2): a point's field at a place s on the sensor is

    U(s) = integral over the open pupil of exp(2 pi i (path(r) / wavelength - r s / scale)),

scale = wavelength x image distance, and |U|² / (scale² x open area) is its share of the light
per square metre. Phases are made in extended precision, as whole and broken turns, by the
formulas of the textbooks; no judge reduces, folds, interpolates or chooses.
"""

from collections.abc import Callable

from hard_cases.judges.chain import Apart as Apart
from hard_cases.judges.chain import by_chain as by_chain
from hard_cases.judges.free_space import Beam as Beam
from hard_cases.judges.free_space import Edges as Edges
from hard_cases.judges.free_space import direct_field as direct_field
from hard_cases.judges.lens import by_airy as by_airy
from hard_cases.judges.lens import by_edges as by_edges
from hard_cases.judges.lens import by_fresnel as by_fresnel
from hard_cases.judges.lens import by_lines as by_lines
from hard_cases.judges.lens import by_rings as by_rings
from hard_cases.judges.lommel import by_lommel as by_lommel
from hard_cases.judges.panel import by_panel as by_panel
from hard_cases.judges.stops import covered as covered
from hard_cases.judges.stops import open_area as open_area
from hard_cases.judges.stops import scan_lines as scan_lines
from hard_cases.judges.sums import Array
from hard_cases.judges.sums import gauss as gauss
from hard_cases.judges.sums import richardson as richardson
from hard_cases.judges.wave import explicit_zernike as explicit_zernike
from hard_cases.view import View

Judge = Callable[[View], Array]
