"""Files of every kind that the judge makes: right in light, or refused by what they are."""

from __future__ import annotations

import numpy as np
import pytest
from judges.picture_files import CRASHED, KINDS, UNNAMED, WRONG, judge_kinds, make_file, table

from labapp.common.errors import UserError
from labapp.files.picture.photograph import read_photograph
from labapp.files.raw import read_raw

MIXTURES = [kind for kind in KINDS if kind.endswith("mixture")]


def bad(kinds, folder, seeds=(0,)):
    """What was read wrongly, refused without a name or left something on the terminal."""

    def read(path, page):
        return read_photograph(path, page=page)

    found = judge_kinds(read, kinds, folder, seeds)
    return table(one for one in found if one.counted in (WRONG, UNNAMED, CRASHED))


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_read_as_what_it_is_or_refused_by_name(kind, tmp_path):
    assert not bad([kind], tmp_path)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.startswith("DNG")])
def test_a_raw_file_gives_its_mosaic_or_is_refused(kind, tmp_path):
    file = make_file(kind, 0, tmp_path)
    if file.valid:
        np.testing.assert_array_equal(read_raw(file.path).mosaic, file.numbers[0])
    else:
        with pytest.raises(UserError):
            read_raw(file.path)


@pytest.mark.sweep
@pytest.mark.parametrize("kind", MIXTURES)
def test_mixtures_are_read_as_what_they_are_or_refused_by_name(kind, tmp_path):
    assert not bad([kind], tmp_path, range(1, 300))


@pytest.mark.sweep
def test_other_draws_of_every_kind_are_read_alike(tmp_path):
    assert not bad(KINDS, tmp_path, range(1, 5))
