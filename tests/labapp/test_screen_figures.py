"""Figures that need an X server say so where there is none."""

from __future__ import annotations

import os

import pytest
from figures.presentations import presentations_figures
from figures.screen import screen_figure


@pytest.mark.parametrize("measure", [screen_figure, presentations_figures])
def test_without_an_x_server_nothing_is_measured(measure, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    figures = measure(tmp_path)
    assert figures
    for figure in figures:
        assert figure.met is None
        assert "isn't installed: sudo apt-get install" in figure.measured


@pytest.mark.xorg
@pytest.mark.parametrize("measure", [screen_figure, presentations_figures])
def test_without_root_nothing_is_measured(measure, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    for figure in measure(tmp_path):
        assert figure.met is None
        assert "root" in figure.measured
