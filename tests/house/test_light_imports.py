"""Who scripts a run over a bench of their own loads the runner, and not the whole house."""

import json
import subprocess
import sys

_LOADED = """
import json, sys
import labapp.runs.acquisition.runner
print(json.dumps(sorted(sys.modules)))
"""


def test_the_runner_knows_what_it_asks_of_a_bench_and_little_else():
    said = subprocess.run([sys.executable, "-c", _LOADED], capture_output=True, check=True).stdout
    loaded = {name: name.partition(".")[0] for name in json.loads(said)}
    assert not {"torch", "scipy", "matplotlib", "PySide6", "serial"} & set(loaded)
    ours = [name for name, room in loaded.items() if room in ("labapp", "optics", "drivers")]
    assert len(ours) <= 70
    assert "simulator" not in loaded.values()
