"""The world's light behind a panel with many effects at once, against the panel drawn finely."""

from dataclasses import replace

import numpy as np
import scipy.ndimage
from judges import positions, relative
from small_bench.world import NEUTRAL, WIDE_OPEN, light_of, ring_pattern, world

from optics.camera import Panel
from optics.slm import PanelMap, PhaseResponse, max_phase
from simulator.scene import Scene, Star

WAVELENGTH = 550e-9
FINE = 20
"""Points across a panel pixel, of which 18 modulate."""

SCENE = Scene({"star": Star(1e-6, 2.0, 1e12)})
ROWS, COLUMNS = WIDE_OPEN.panel.shape
X = np.arange(256) / 255
SHARES = 0.95 * (X**1.2 + 0.02 * np.sin(2 * np.pi * X))
Y_, X_ = np.mgrid[-1 : 1 : ROWS * 1j, -1 : 1 : COLUMNS * 1j]
FIGURE = 60e-9 * (X_**2 - Y_ + 0.5 * X_ * Y_)
BEAM = np.exp(-((X_ - 0.2) ** 2 + Y_**2) / 1.5)


def drawn(phase: np.ndarray, sigma: float, figure: np.ndarray, beam: np.ndarray) -> np.ndarray:
    """The field over the panel, FINE points a pixel: blurred phase, dark gaps, a lit figure."""

    def fine(values):
        return np.kron(values, np.ones((FINE, FINE)))

    blurred = scipy.ndimage.gaussian_filter(fine(phase), sigma * FINE, mode="nearest", truncate=6)
    inside = np.abs((np.arange(FINE) + 0.5) / FINE - 0.5) < 0.45
    active = np.kron(np.ones((ROWS, COLUMNS)), np.outer(inside, inside))
    return np.sqrt(fine(beam)) * np.exp(1j * (blurred + fine(figure))) * active


def light_on(field: np.ndarray) -> np.ndarray:
    """On the sensor's pixels, 4 x 4 points each, of a star in focus."""
    panel, sensor = WIDE_OPEN.panel, WIDE_OPEN.sensor
    scale = WAVELENGTH * WIDE_OPEN.lens.image_distance
    inner = ((np.arange(FINE) + 0.5) / FINE - 0.5) * panel.pitch
    nodes, weights = np.polynomial.legendre.leggauss(4)
    down, along = (
        np.exp(
            -2j
            * np.pi
            / scale
            * np.outer(
                (positions(m, sensor.pitch)[:, None] + nodes * sensor.pitch / 2).ravel(),
                (positions(n, panel.pitch)[:, None] + inner).ravel(),
            )
        )
        for m, n in zip(sensor.shape, panel.shape, strict=True)
    )
    light = np.abs(down @ field @ along.T) ** 2
    blocks = light.reshape(sensor.shape[0], 4, sensor.shape[1], 4)
    return np.einsum("iajb,a,b->ij", blocks, weights, weights)


def star(panel: Panel, grey: np.ndarray = NEUTRAL, tol: float = 2e-3) -> np.ndarray:
    """What the world makes of it, at one wavelength."""
    camera = replace(WIDE_OPEN, panel=panel)
    return light_of(world(camera, SCENE, tol=tol, forced={"filter bandwidth": False}), grey)


def test_a_panel_with_many_effects_is_the_panel_drawn_finely():
    plain = replace(WIDE_OPEN.panel, unmodulated=0.0)
    effects = {
        "unmodulated": 0.06,
        "front_reflection": 0.012,
        "coupling": 0.15 * 40e-6,
        "response": PhaseResponse.from_curve(WAVELENGTH, SHARES),
        "flatness": PanelMap(FIGURE),
        "illumination": PanelMap(BEAM),
    }
    panel, grey = replace(plain, **effects), ring_pattern(120e-6, WIDE_OPEN)
    all_light = star(plain).sum()
    even, flat = np.ones((ROWS, COLUMNS)), np.zeros((ROWS, COLUMNS))
    phase = max_phase(panel, WAVELENGTH) * SHARES[grey]
    path, beam = FIGURE * 2 * np.pi / WAVELENGTH, BEAM / BEAM.mean()
    front = 0.012 / 0.6
    turned = light_on(drawn(phase, 0.15, path, beam))
    unturned = light_on(drawn(flat, 0.15, path, beam))
    glass = light_on(drawn(flat, 0.15, flat, beam))
    truth = (1 - front) * (0.94 * turned + 0.06 * unturned) + front * glass
    truth /= light_on(drawn(flat, 0.15, flat, even)).sum()
    assert relative(star(panel, grey) / all_light, truth) <= 5e-3
    # Without any of them it is another picture.
    for field in effects:
        without = replace(panel, **{field: getattr(plain, field)})
        assert relative(star(without, grey) / all_light, truth) > 0.015
