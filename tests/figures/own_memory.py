"""The memory of this process, as the system tells it."""

from __future__ import annotations

import re
from pathlib import Path


def own_memory(name: str) -> int:
    """Bytes of this process: in use ("VmRSS"), or the most since it began ("VmHWM").

    Its resource usage won't do: that counts the process that started it as well.
    """
    status = Path("/proc/self/status").read_text()
    found = re.search(rf"^{name}:\s*(\d+) kB", status, re.MULTILINE)
    assert found is not None
    return 1024 * int(found[1])
