"""The matrix from a sensor's channels to linear sRGB."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from labapp.files.sensor_file import read_sensor
from labapp.pictures.colour_matrix import (
    linear_srgb,
    linear_srgb_matrix,
    white_balance,
)
from optics.light import Spectrum, blackbody, monochromatic
from optics.sensor import Mosaic

NM = np.arange(380.0, 781.0)

XYZ_TO_LINEAR_SRGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
"""IEC 61966-2-1:1999."""

D65_WHITE = np.array([0.9505, 1.0, 1.0890])
"""X, Y and Z of D65, from the same standard."""


def spectrum(values) -> Spectrum:
    return Spectrum(tuple(NM * 1e-9), tuple(values))


def tabulated(distribution) -> np.ndarray:
    return np.interp(NM, distribution.wavelengths, distribution.values)


@pytest.fixture(scope="module", autouse=True)
def library() -> None:
    """What colour-science warns of when it is imported is no failure of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour.quality  # noqa: F401


@pytest.fixture(scope="module")
def observer() -> np.ndarray:
    """CIE 1931, (3, wavelengths)."""
    import colour

    table = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.array([np.interp(NM, table.wavelengths, one) for one in table.values.T])


@pytest.fixture(scope="module")
def d65() -> Spectrum:
    import colour

    return spectrum(tabulated(colour.SDS_ILLUMINANTS["D65"]))


@pytest.fixture(scope="module")
def illuminant_a() -> np.ndarray:
    import colour

    return tabulated(colour.SDS_ILLUMINANTS["A"])


@pytest.fixture(scope="module")
def packaged() -> Mosaic:
    mosaic = read_sensor("dvc-4000c-like", Path()).build().colour
    assert mosaic is not None
    return mosaic


def balanced(mosaic: Mosaic, reflectances: np.ndarray, light: np.ndarray, used=NM > 0):
    """White-balanced signals, (channels, patches)."""
    curves = np.array([mosaic.efficiencies[name].at(NM * 1e-9) for name in mosaic.channels])
    photons = curves * light * NM * used
    return photons @ reflectances.T / photons.sum(axis=1)[:, None]


def xyz_in_d65(reflectances: np.ndarray, light: np.ndarray, observer: np.ndarray) -> np.ndarray:
    """What the eye sees, adapted by Bradford's transform, (patches, 3)."""
    import colour

    white = observer @ light
    adapted = colour.chromatic_adaptation(
        reflectances * light @ observer.T / white[1], white / white[1], D65_WHITE,
        method="Von Kries", transform="Bradford",
    )  # fmt: skip
    return np.asarray(adapted)


def colour_errors(matrix, mosaic, light, observer, used=NM > 0) -> np.ndarray:
    """CIE DE2000 of the 99 reflectances of CIE 224:2017, none of which is fitted."""
    import colour
    from colour.quality.cfi2017 import load_TCS_CIE2017

    samples = load_TCS_CIE2017(colour.SpectralShape(380, 780, 1)).values.T
    seen = (matrix @ balanced(mosaic, samples, light, used)).T
    white = colour.XYZ_to_xy(D65_WHITE)
    given, right = (
        colour.XYZ_to_Lab(xyz, white)
        for xyz in (
            seen @ np.linalg.inv(XYZ_TO_LINEAR_SRGB).T,
            xyz_in_d65(samples, light, observer),
        )
    )
    return np.asarray(colour.delta_E(given, right, method="CIE 2000"))


def test_a_sensor_that_sees_as_the_eye_does_has_an_exact_matrix(observer, d65):
    """Luther's condition: efficiency times wavelength is a mixture of the observer's curves."""
    mixture = np.array([[0.8, 0.15, 0.05], [0.3, 0.9, 0.1], [0.02, 0.05, 0.5]])
    curves = mixture @ observer / NM * 100
    mosaic = Mosaic(("RG", "GB"), dict(zip("RGB", map(spectrum, curves), strict=True)))
    expected = XYZ_TO_LINEAR_SRGB @ np.linalg.inv(mixture) * (mixture @ D65_WHITE)
    assert linear_srgb_matrix(mosaic, d65) == pytest.approx(expected, abs=2e-3)


def test_columns_are_in_the_order_of_the_channels(packaged):
    turned = Mosaic(("BG", "GR"), packaged.efficiencies)
    assert turned.channels == ("B", "G", "R")
    assert linear_srgb_matrix(turned) == pytest.approx(linear_srgb_matrix(packaged)[:, ::-1])


@pytest.mark.parametrize("passband", [None, (480e-9, 630e-9)])
@pytest.mark.parametrize("kelvin", [1900, 6500])
def test_white_stays_white(packaged, kelvin, passband):
    matrix = linear_srgb_matrix(packaged, blackbody(kelvin), passband)
    assert matrix @ np.ones(3) == pytest.approx(np.ones(3), abs=1e-12)


def test_the_fit_is_the_best_of_those_that_keep_white(packaged, observer, illuminant_a):
    """Solved with one channel eliminated by the condition that rows sum to 1."""
    import colour

    patches = np.array(
        [tabulated(one) for one in colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()]
    )
    red, green, blue = balanced(packaged, patches, illuminant_a)
    goal = (xyz_in_d65(patches, illuminant_a, observer) @ XYZ_TO_LINEAR_SRGB.T).T
    apart = np.stack([green - red, blue - red], axis=1)
    two = np.linalg.lstsq(apart, (goal - red).T, rcond=None)[0].T
    expected = np.column_stack([1 - two.sum(axis=1), two])
    # The module's light is illuminant A by default.
    assert linear_srgb_matrix(packaged) == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize(("passband", "limit"), [(None, 6.5), ((400e-9, 700e-9), 4.7)])
def test_colours_of_the_packaged_sensor_are_near_those_that_the_eye_sees(
    packaged, observer, illuminant_a, passband, limit
):
    low, high = np.array(passband or (0, 1)) * 1e9
    used = (low <= NM) & (high >= NM)
    matrix = linear_srgb_matrix(packaged, passband=passband)
    errors = colour_errors(matrix, packaged, illuminant_a, observer, used)
    without = colour_errors(np.eye(3), packaged, illuminant_a, observer, used)
    assert errors.mean() < limit
    assert errors.mean() < 0.6 * without.mean()


def test_a_white_pixel_beside_the_colours_changes_nothing_if_it_is_their_sum(
    packaged, illuminant_a, rng
):
    nm = tuple(NM * 1e-9)
    curves = {name: packaged.efficiencies[name].at(nm) for name in "RGB"}
    four = Mosaic(
        ("RG", "BW"), {name: spectrum(one) for name, one in curves.items()}
        | {"W": spectrum(sum(curves.values()) * 0.9)},
    )  # fmt: skip
    samples = rng.uniform(size=(5, len(NM)))
    matrix = linear_srgb_matrix(four)
    assert matrix.shape == (3, 4)
    assert matrix @ np.ones(4) == pytest.approx(np.ones(3))
    assert matrix @ balanced(four, samples, illuminant_a) == pytest.approx(
        linear_srgb_matrix(packaged) @ balanced(packaged, samples, illuminant_a), abs=1e-6
    )


def test_white_balance_is_what_white_gives(packaged, illuminant_a):
    curves = np.array([packaged.efficiencies[name].at(NM * 1e-9) for name in "RGB"])
    signals = curves @ (illuminant_a * NM)
    assert white_balance(packaged) == pytest.approx(signals / signals.max(), rel=1e-3)
    used = (NM >= 500) & (NM <= 600)
    signals = curves @ (illuminant_a * NM * used)
    found = white_balance(packaged, passband=(499.5e-9, 600.5e-9))
    assert found == pytest.approx(signals / signals.max(), rel=1e-3)


def test_a_narrow_line_counts_wherever_it_lies(packaged):
    """Much narrower than the step of the sum over wavelengths."""
    for middle in (520.0e-9, 520.37e-9, 520.5e-9):
        found = white_balance(packaged, monochromatic(middle, 0.01e-9))
        curves = np.array([float(packaged.efficiencies[name].at(middle)) for name in "RGB"])
        assert found == pytest.approx(curves / curves.max(), rel=0.02)


def test_a_channel_without_light_has_no_white_balance(packaged):
    assert white_balance(_without_blue(packaged))[2] == 0


@pytest.mark.parametrize(("kelvin", "expected"), [(2856, 4), (1900, 10)])
def test_noise_is_amplified_as_the_limit_says(packaged, rng, kelvin, expected):
    """Photon noise of white pixels, counted."""
    electrons, light = 1e4, blackbody(kelvin)
    mean = electrons * white_balance(packaged, light)[:, None, None]
    white = rng.poisson(np.broadcast_to(mean, (3, 200, 200))) / mean
    noise = linear_srgb(white, linear_srgb_matrix(packaged, light)).std(axis=(1, 2))
    assert max(noise) * np.sqrt(electrons) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(
    ("passband", "words"),
    [
        ((545e-9, 555e-9), "in light of 545 to 555 nm.*Take a wider filter.*grey"),
        ((520e-9, 620e-9), "in light of 520 to 620 nm.*noise 15.* times, and 12 is the most"),
        ((750e-9, 760e-9), "no channel of R, G, B detects this light from 750 to 760 nm"),
        ((800e-9, 900e-9), "passband is 800 to 900 nm, which is invisible"),
        ((600e-9, 500e-9), "passband is 6e-07 to 5e-07 m; give the shorter wavelength first"),
        ((400, 700), "passband is .* invisible; give metres"),
    ],
)
def test_a_passband_without_colours_is_refused(packaged, passband, words):
    with pytest.raises(ValueError, match=words):
        linear_srgb_matrix(packaged, passband=passband)


def test_a_light_without_colours_is_refused(packaged):
    with pytest.raises(ValueError, match=r"in light of 588 to 590 nm.*Take light of more"):
        linear_srgb_matrix(packaged, monochromatic(589e-9))
    with pytest.raises(ValueError, match="light is dark from 380 to 780 nm"):
        linear_srgb_matrix(packaged, Spectrum.flat(1.0, 800e-9, 900e-9))


def test_channels_that_cannot_tell_colours_are_refused(packaged):
    curves = packaged.efficiencies
    alike = Mosaic(("RG", "GB"), dict.fromkeys("RGB", curves["G"]))
    with pytest.raises(ValueError, match="channels R, G, B differ in fewer than two ways"):
        linear_srgb_matrix(alike)
    with pytest.raises(ValueError, match=r"by 2 channels \(R, G\)"):
        linear_srgb_matrix(Mosaic(("RG",), curves))
    with pytest.raises(ValueError, match="channel B gets none of it"):
        linear_srgb_matrix(_without_blue(packaged))


def _without_blue(mosaic: Mosaic) -> Mosaic:
    return Mosaic(mosaic.pattern, {**mosaic.efficiencies, "B": Spectrum.flat(0.0)})


def test_the_matrix_acts_on_each_pixel(rng):
    picture, matrix = rng.normal(size=(4, 2, 3)), rng.normal(size=(3, 4))
    found = linear_srgb(picture, matrix)
    assert found.shape == (3, 2, 3)
    assert found[:, 1, 2] == pytest.approx(matrix @ picture[:, 1, 2])
    assert linear_srgb(picture.astype(np.float32), matrix).dtype == np.float32


@pytest.mark.parametrize(
    ("picture", "matrix", "words"),
    [
        ((3, 4, 5), (4, 3), r"matrix is \(4, 3\); it must be \(3, channels\)"),
        ((3, 4, 5), (3,), r"matrix is \(3,\)"),
        ((4, 5, 3), (3, 3), r"picture is \(4, 5, 3\).*must be \(3, rows, columns\)"),
        ((3, 4), (3, 3), r"picture is \(3, 4\)"),
    ],
)
def test_wrong_shapes_are_refused(picture, matrix, words):
    with pytest.raises(ValueError, match=words):
        linear_srgb(np.ones(picture), np.ones(matrix))


def test_who_computes_no_matrix_waits_for_no_library():
    code = "import sys, labapp.pictures.colour_matrix; sys.exit('colour' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
