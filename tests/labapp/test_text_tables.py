"""Text tables of other programs: read right, or refused as what they are."""

from __future__ import annotations

import pytest
from figures.text_tables import judge, rows_of_lut, rows_of_spectra
from judges.text_tables import broken_tables, spectra_tables, vendor_tables

from labapp.common.errors import UserError
from labapp.files.lut_file import read_lut
from labapp.files.reading import read_text
from labapp.files.spectrum_file import read_spectra


@pytest.mark.parametrize(
    ("tables", "read"),
    [
        (spectra_tables(3), rows_of_spectra),
        (vendor_tables(3), rows_of_lut),
        (broken_tables(), rows_of_spectra),
    ],
)
def test_tables_are_read_right_or_refused_by_name(tables, read, tmp_path):
    fates = judge(tables, read, tmp_path)
    assert set(fates.values()) <= {"right", "named"}, fates


def test_units_in_headings_are_obeyed(tmp_path):
    path = tmp_path / "filter.csv"
    path.write_bytes("wavelength (µm);T (%)\n0,4;50\n0,5;20\n".encode("cp1252"))
    assert read_spectra(path)["T (%)"].values == (0.5, 0.2)
    path.write_text("wavenumber (cm-1)\tT\n20000\t0.5\n25000\t1\n")
    assert read_spectra(path)["T"].wavelengths == pytest.approx((400e-9, 500e-9))


def test_a_table_of_voltages_is_never_one_of_phases(tmp_path):
    path = tmp_path / "lut.csv"
    path.write_text("level, voltage\n0, 0\n255, 5\n")
    with pytest.raises(UserError, match=r"names voltages.*Measure the phase, by labapp calibrate"):
        read_lut(path, 256)


def test_keys_are_text_in_utf_8_or_with_a_mark(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_bytes("title = 'é'".encode("utf-16"))
    assert read_text(path, "a plan") == "title = 'é'"
    path.write_bytes("version = 1\ntitle = 'é'".encode("latin-1"))
    with pytest.raises(UserError, match=r"is text, but line 2 isn't in UTF-8. Save the file as"):
        read_text(path, "a plan")
