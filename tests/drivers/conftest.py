"""What tests of panels on X displays share: a small server, and windows with time to reply."""

from __future__ import annotations

import pytest
from xservers import be_patient, xvfb


@pytest.fixture(scope="module")
def server():
    """A virtual display of 160 x 120 pixels; tests on a real X server have their own."""
    with xvfb(160, 120) as running:
        yield running


@pytest.fixture
def patient(monkeypatch):
    be_patient(monkeypatch)
