"""The CS-2000's machine as colour-specio's driver finds it, which others have written.

It wants Python 3.13, so that it runs in a Python of its own: the one that the environment
variable LABAPP_SPECIO_PYTHON names, or this one where the extra "spectro" is installed.
"""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.cs2000_settings import WAVELENGTHS
from simulator.wire import SimulatedLine
from simulator.wire.pty import PtyLine


def python_with_specio():
    named = os.environ.get("LABAPP_SPECIO_PYTHON")
    if named:
        return named
    return sys.executable if importlib.util.find_spec("specio") else None


def light(wavelengths):
    nm = wavelengths * 1e9
    return 2e5 * (1 + 0.5 * np.sin(nm / 23) + nm / 1000)


@pytest.mark.skipif(python_with_specio() is None, reason="colour-specio is in no Python here")
def test_it_measures_our_machine(tmp_path):
    machine = CS2000Machine(light, slit_nm=0)
    with PtyLine(SimulatedLine(machine, baudrate=115200), tmp_path / "cs2000") as served:
        script = Path(__file__).with_name("specio_measures.py")
        done = subprocess.run(
            [python_with_specio(), "-W", "ignore", str(script), str(served.path)],
            capture_output=True,
            text=True,
            timeout=100,
        )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert (told["model"], told["serial"]) == ("CS-2000A", "1000123")
    assert told["nanometres"] == pytest.approx(WAVELENGTHS * 1e9)
    assert told["values"] == pytest.approx(light(WAVELENGTHS) * 1e-9, rel=1e-6)
    assert told["exposure"] == pytest.approx(int(machine.conditions.split(",")[2]) * 1e-6)
