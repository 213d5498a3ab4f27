"""A judge of a panel that stands apart from its lens: the light in the stop, line by line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.special
from numpy.typing import NDArray

from judges.basics import positions
from judges.panel import pixel_coverage, with_unmodulated
from judges.pixels import lines_of, on_pixels, scale_of
from judges.stops import scan_lines
from judges.sums import Array, gauss, phasor, times
from judges.view import View
from judges.wave import steepest, turns
from optics.camera import Camera

_AT_ONCE = 16
"""Lines of a stop, of some hundred nodes each."""


@dataclass(frozen=True)
class Apart(View):
    """A point's light through panel, space, lens and stop, and space.

    off_axis, sphere: `field` and `sphere` of PSFOperator; pixels lie around the point's image.
    """

    off_axis: tuple[Any, Any] = (0.0, 0.0)
    sphere: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        return {"field": self.off_axis, "sphere": self.sphere}

    def __str__(self) -> str:
        assert isinstance(self.optics, Camera)
        words = f"{super().__str__()}, panel {float(self.optics.separation):.3g} m before the lens"
        if any(float(place) for place in self.off_axis):
            words += ", image at ({:.3g}, {:.3g}) mm".format(
                *(1e3 * float(p) for p in self.off_axis)
            )
        return words + (", exact sphere" if self.sphere else "")


def by_chain(view: View) -> Array:
    """Fresnel's integrals to the lens and on to the sensor, line by line"""
    assert isinstance(view, Apart)
    return with_unmodulated(view, partial(_chain_light, view))


def _chain_light(view: Apart, modulation: NDArray[np.complex128]) -> Array:
    """Along each axis the waves of thesis Eq. 5.1 to 5.6 have the exponent pi i / wavelength
    times (p - o)² / d + (x - p)² / z1 - x² / f + (u - x)² / z2, with o the object, p on the
    panel, x in the stop and u on the sensor."""
    assert isinstance(view.optics, Camera)
    lens, radius, scale = view.lens, float(view.lens.stop_diameter) / 2, scale_of(view)
    v, u, wv, wu = lines_of(view)
    v, u = (seen + float(place) for seen, place in zip((v, u), view.off_axis, strict=True))
    panel = _Panel.of(view, modulation)
    # Nearly a node a radian is plenty: half of them would do, and here they are dear.
    slope = 0.6 * panel.slope((v, u)) * radius
    lines = scan_lines(lens.stop, slope)
    heights = np.array([y for y, _, _ in lines]) * radius
    sent = panel.towards(0, heights) @ panel.wave
    rows: list[NDArray[np.complex128]] = []
    # Many lines at a time: a line by itself is too short for numpy.
    for some in np.array_split(np.arange(len(lines)), math.ceil(len(lines) / _AT_ONCE)):
        line = np.repeat(some, [lines[k][1].size for k in some])
        x = np.concatenate([lines[k][1] for k in some]) * radius
        light = (sent[line] * panel.towards(1, x)).sum(axis=1)
        light *= phasor(panel.left_over(heights[line], x))
        light *= np.concatenate([lines[k][2] for k in some])
        ends = np.cumsum([lines[k][1].size for k in some])[:-1]
        kernel = np.exp(-2j * np.pi / scale * np.outer(u, x))
        parts = zip(np.split(kernel, ends, axis=1), np.split(light, ends), strict=True)
        rows += [times(each, part) for each, part in parts]
    field = np.exp(-2j * np.pi / scale * np.outer(v, heights)) @ np.array(rows) * radius**2
    passed = float(pixel_coverage(view.optics).sum()) * view.optics.panel.active_side**2
    return on_pixels(view, np.abs(field) ** 2 / (scale**2 * passed), wv, wu)


@dataclass(frozen=True)
class _Panel:
    """The light of a panel on its way to the lens: a wave on nodes, and what an axis adds."""

    view: Apart
    wave: NDArray[np.complex128]
    nodes: tuple[Array, Array]

    @staticmethod
    def of(view: Apart, modulation: NDArray[np.complex128]) -> _Panel:
        """Of an exact sphere, on Gauss-Legendre nodes inside the pixels; else pixel by pixel."""
        assert isinstance(view.optics, Camera)
        panel = view.optics.panel
        middles = positions(panel.shape[0], panel.pitch), positions(panel.shape[1], panel.pitch)
        if not view.sphere:
            return _Panel(view, modulation, middles)
        assert not any(view.off_axis)
        half, reach = panel.active_side / 2, max(panel.shape) * panel.pitch / 2
        near = (float(view.lens.stop_diameter) / 2 + reach) / float(view.optics.separation)
        slope = near + reach / float(view.distance)
        inner, weight = gauss(16 + math.ceil(2 * np.pi / float(view.wavelength) * slope * half))
        y, x = ((middle[:, None] + half * inner).ravel() for middle in middles)
        wy, wx = (np.tile(half * weight, n) for n in panel.shape)
        away = np.add.outer(y.astype(np.longdouble) ** 2, x.astype(np.longdouble) ** 2)
        d = np.longdouble(float(view.distance))
        r = np.sqrt(away + d**2)
        sphere = phasor((r - d) / float(view.wavelength)) * (d / r).astype(float)
        wave = np.kron(modulation, np.ones((inner.size, inner.size))) * np.outer(wy, wx) * sphere
        return _Panel(view, wave, (y, x))

    @property
    def _lengths(self) -> tuple[float, float, float]:
        """z1, 1 / d and the wavelength."""
        assert isinstance(self.view.optics, Camera)
        z1, wavelength = float(self.view.optics.separation), float(self.view.wavelength)
        return z1, 1 / float(self.view.distance), wavelength

    def _tilt(self, axis: int) -> float:
        """-o / d, of the object whose image lies at the view's place: it is inverted."""
        z1, near, _ = self._lengths
        return (
            float(self.view.off_axis[axis]) / float(self.view.lens.image_distance) * (1 + z1 * near)
        )

    def towards(self, axis: int, x: Array) -> NDArray[np.complex128]:
        """From each node to places x at the lens, without what left_over() has."""
        z1, near, wavelength = self._lengths
        if self.view.sphere:
            turn = (x[:, None] - self.nodes[axis]) ** 2 / (2 * wavelength * z1)
            return phasor(turn) / math.sqrt(wavelength * z1)
        assert isinstance(self.view.optics, Camera)
        half = self.view.optics.panel.active_side / 2
        bend = near + 1 / z1
        centre = (x / z1 - self._tilt(axis)) / bend
        stretch = math.sqrt(2 * bend / wavelength)
        ends = [self.nodes[axis] + side - centre[:, None] for side in (-half, half)]
        (s0, c0), (s1, c1) = (scipy.special.fresnel(stretch * end) for end in ends)
        sent = (c1 - c0 + 1j * (s1 - s0)) / stretch / math.sqrt(wavelength * z1)
        own = (x**2 / z1 - bend * centre**2) / (2 * wavelength)
        return np.asarray(phasor(own)[:, None] * sent)

    def left_over(self, y: Array, x: Array) -> Any:
        """Waves of path at places in the lens: its own phase, and the way to the sensor."""
        lens, (z1, _, wavelength) = self.view.lens, self._lengths
        r2 = np.asarray(y, np.longdouble) ** 2 + np.asarray(x, np.longdouble) ** 2
        # 1 / z2 - 1 / f is -1 / focus, by the thin-lens equation.
        focus = np.longdouble(float(lens.focus_distance))
        waves = -r2 / (2 * focus * np.longdouble(wavelength))
        whole = float(self.view.distance) + z1
        parabola = (1 / np.longdouble(whole) - 1 / focus) * r2 / 2 / wavelength
        return waves + turns(lens, whole, wavelength, y, x) - parabola

    def slope(self, seen: tuple[Array, Array]) -> float:
        """The most radians a metre by which the light turns in the stop: that from the panel's
        ends, and that which goes straight on."""
        lens, (z1, near, wavelength) = self.view.lens, self._lengths
        assert isinstance(self.view.optics, Camera)
        panel, radius = self.view.optics.panel, float(lens.stop_diameter) / 2
        image, focus = float(lens.image_distance), float(lens.focus_distance)
        most = []
        for axis, on_sensor in enumerate(seen):
            half = (panel.shape[axis] / 2 + 1) * panel.pitch
            rates = [
                rate - x / focus - u / image
                for x in (-radius, radius)
                for u in (on_sensor.min(), on_sensor.max())
                for rate in (
                    (x - half) / z1,
                    (x + half) / z1,
                    (x * near + self._tilt(axis)) / (1 + z1 * near),
                )
            ]
            most.append(max(map(abs, rates)))
        # An edge's light begins to turn within a Fresnel zone.
        own = 4 / math.sqrt(wavelength * z1)
        if lens.aberrations or lens.kind != "thin":
            own += steepest(self.view, radius)
        return 2 * np.pi / wavelength * math.hypot(*most) + own
