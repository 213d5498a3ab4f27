import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.light_table import LightTable
from labapp.files.reading import FileModel, validate
from labapp.files.reflectance_table import mallett_basis, reflectance_spectrum
from labapp.files.spectrum_file import bundled_spectra, read_spectra, read_spectrum
from optics.light import blackbody, halogen, lamp_from_table


class OneLight(FileModel):
    light: LightTable


def lamp(**table):
    return validate({"light": table}, OneLight, "scene.toml").light.build()


def test_a_spectrum_is_read_with_remarks_and_a_title(tmp_path):
    path = tmp_path / "qe.csv"
    path.write_text("# of a sensor\nnm, red, green\n400, 0.1, 0.2 # dark\n\n700,0.5,0\n")
    spectra = read_spectra(path)
    assert list(spectra) == ["red", "green"]
    assert spectra["red"].wavelengths == pytest.approx((400e-9, 700e-9))
    assert read_spectrum(path, "green").values == (0.2, 0.0)


def test_a_spectrum_without_a_title_and_with_semicolons(tmp_path):
    path = tmp_path / "lamp.csv"
    path.write_text("400;0.5\n500;1\n")
    assert read_spectrum(path).values == (0.5, 1.0)
    assert list(read_spectra(path)) == ["1"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is no table of spectra"),
        ("nm,red\n", "is no table of spectra"),
        ("400\n500\n", "is no table of spectra"),
        ("nm,red,green\n400,1\n500,1\n", "is no table of spectra"),
        ("400,1\n500\n", "line 2: has 1 numbers"),
        ("400,1\n500,x\n", "line 2: '500,x' isn't finite numbers"),
        ("500,1\n400,1\n", "don't rise"),
        ("400,1\n500,-1\n", "a value is -1"),
        ("400,1\n500,nan\n", "'500,nan' isn't finite numbers"),
        ("nm,a,a\n400,1,1\n500,1,1\n", "two columns have the same name"),
        ("nm,a,b\n400,1,1\n500,1,1\n", "has 2 columns; name one: a, b"),
        ("400,1\n", "a spectrum needs two or more"),
    ],
)
def test_a_table_that_is_no_spectrum_is_refused(tmp_path, text, words):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        read_spectrum(path)
    assert "bad.csv" in str(caught.value)


def test_a_spectrum_that_is_not_there_is_told(tmp_path):
    with pytest.raises(UserError, match="cannot be read"):
        read_spectra(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(UserError, match="is not a text file"):
        read_spectra(tmp_path / "binary.csv")
    (tmp_path / "one.csv").write_text("nm,a\n400,1\n500,1\n")
    with pytest.raises(UserError, match="has no column 'b'; choose among a"):
        read_spectrum(tmp_path / "one.csv", "b")


def test_the_basis_adds_up_to_white_and_has_its_colours():
    """Mallett and Yuksel's table: white is 1 at all wavelengths, and nothing is above it."""
    red, green, blue = mallett_basis()
    x = np.linspace(300e-9, 1100e-9, 801)
    assert red.at(x) + green.at(x) + blue.at(x) == pytest.approx(1, abs=1e-4)
    assert red.at(650e-9) > 0.9 > 0.1 > red.at(480e-9)
    assert green.at(540e-9) > 0.9
    assert blue.at(450e-9) > 0.9
    assert max(one.peak for one in (red, green, blue)) <= 1.0


def test_the_24_patches_end_with_six_greys_that_darken():
    patches = list(bundled_spectra("colorchecker").values())
    assert len(patches) == 24
    # Densities that the chart's own names tell: reflectances of 10^-0.23 and so on, at 550 nm.
    for patch, density in zip(patches[18:], (0.05, 0.23, 0.44, 0.70, 1.05, 1.50), strict=True):
        assert float(patch.at(550e-9)) == pytest.approx(10**-density, rel=0.1)


def test_a_reflectance_is_a_name_a_number_a_colour_or_a_table(tmp_path):
    assert reflectance_spectrum(0.4).at([4e-7, 9e-7]).tolist() == [0.4, 0.4]
    assert reflectance_spectrum((0.3, 0.3, 0.3)).at(5e-7) == pytest.approx(0.3, abs=1e-4)
    assert reflectance_spectrum("red").at(650e-9) > 3 * reflectance_spectrum("red").at(500e-9)


def test_lamps_are_what_their_tables_say(tmp_path):
    assert lamp(kind="halogen").spectrum == halogen()
    assert lamp(kind="halogen").waveform is None
    assert lamp(kind="blackbody", temperature_k=5000.0).spectrum == blackbody(5000.0)
    even = lamp(kind="broadband", range_nm=[450.0, 650.0]).spectrum
    assert even.at([449e-9, 500e-9, 651e-9]).tolist() == [0, 1, 0]
    line = lamp(kind="monochromatic", wavelength_nm=532.0, width_nm=2.0).spectrum
    assert line.at([531e-9, 532e-9]) == pytest.approx([0.5, 1.0])
    (tmp_path / "lamp.csv").write_text("400,2\n700,4\n")
    table = lamp(kind="table", file=str(tmp_path / "lamp.csv"))
    assert table.spectrum.at([400e-9, 700e-9]) == pytest.approx([0.5, 1.0])


def test_the_studio_tungsten_of_iso_7589_is_a_halogen_lamp():
    measured = lamp_from_table(bundled_spectra("studio-tungsten")["radiance"])
    x = np.linspace(400e-9, 690e-9, 30)
    lamp = halogen().at(x) / halogen().at(690e-9)
    assert np.linalg.norm(measured.at(x) - lamp) < 0.06 * np.linalg.norm(lamp)


def test_a_lamp_may_flicker():
    flicker = {"shape": "sine", "frequency_hz": 120.0, "depth": 0.2, "phase_deg": 90.0}
    wave = lamp(kind="halogen", flicker=flicker).waveform
    assert wave.ripple == pytest.approx(0.2)
    assert wave.at(0.0) == pytest.approx(1.2)
    assert wave.period == pytest.approx(1 / 120)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"kind": "candle"}, "light"),
        ({"kind": "halogen", "temperature_k": 10.0}, "temperature_k"),
        ({"kind": "blackbody"}, "temperature_k.* is missing"),
        ({"kind": "broadband", "range_nm": [700.0, 400.0]}, "the shorter wavelength first"),
        ({"kind": "monochromatic", "wavelength_nm": 500.0, "width_nm": 600.0}, "narrower"),
        ({"kind": "halogen", "flicker": {"depth": 2.0}}, "depth"),
        ({"kind": "halogen", "flicker": {"depth": 0.1, "shape": "saw"}}, "shape"),
        ({"kind": "halogen", "watts": 50}, "watts.* is unknown"),
    ],
)
def test_a_lamp_that_cannot_be_is_refused(table, words):
    with pytest.raises(UserError, match=words):
        lamp(**table)
