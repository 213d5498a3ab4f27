"""Files of every kind that the judge makes: right in light, or refused by what they are."""

from __future__ import annotations

import pytest
from judges.picture_files import CRASHED, KINDS, UNNAMED, WRONG, judge_kinds, table

from labapp.files.picture.photograph import read_photograph

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


@pytest.mark.sweep
@pytest.mark.parametrize("kind", MIXTURES)
def test_mixtures_are_read_as_what_they_are_or_refused_by_name(kind, tmp_path):
    assert not bad([kind], tmp_path, range(1, 300))


@pytest.mark.sweep
def test_other_draws_of_every_kind_are_read_alike(tmp_path):
    assert not bad(KINDS, tmp_path, range(1, 5))
