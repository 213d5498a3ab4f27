"""Old names of modules: what they held is still there, or its place is said."""

import importlib

import pytest

from optics import inverse, measuring, psf
from optics.camera import stop
from optics.moved import _NEW


@pytest.mark.parametrize("old", sorted(_NEW))
def test_an_old_name_leads_to_the_module_of_today(old):
    found, new = importlib.import_module(old), importlib.import_module(_NEW[old])
    for name in getattr(new, "__all__", [n for n in vars(new) if not n.startswith("_")]):
        assert getattr(found, name) is getattr(new, name)


def test_what_scripts_import_is_what_they_got():
    from optics.alignment import focus_score
    from optics.chain import CHAIN_METHODS
    from optics.deconvolution import restore
    from optics.deconvolution.observation import Observation
    from optics.stop.aperture import Circle

    assert focus_score is measuring.focus_score
    assert CHAIN_METHODS is psf.CHAIN_METHODS
    assert (restore, Observation) == (inverse.restore, inverse.Observation)
    assert Circle is stop.Circle


def test_what_is_no_more_is_refused_with_the_place_to_look():
    with pytest.raises(
        ModuleNotFoundError, match=r"optics\.chain\.grid is no more; look in optics\.psf"
    ):
        importlib.import_module("optics.chain.grid")
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'optics\.nothing'"):
        importlib.import_module("optics.nothing")
