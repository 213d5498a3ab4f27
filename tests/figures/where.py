"""Where a process of the figures' own starts, so that it finds both them and the application.

In the folder of the tests, `labapp` would be that of the application's tests.
"""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT / "tests")}

PACKAGES = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
"""The same for one that starts elsewhere; the application's packages are found first."""
