"""What the simulated camera's process makes of pictures that come when they come."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any

from simulator.wire.gige_process import GigEMachine


class Bare(GigEMachine):
    """The camera without Aravis: its registers, and those who make its pictures."""

    def __init__(self, fresh: bool) -> None:
        self.registers: dict[int, int] = defaultdict(int)
        self.wanted: list[dict[str, Any]] = []
        self.ask = self.wanted.append
        self._start_settings, self._memory = {"fresh": fresh}, bytearray(8)  # type: ignore[assignment]
        self._key: Any = None
        self._pending_key: Any = None
        self._places, self._request = [], {}
        self._arrived = threading.Condition()

    def _register(self, address: int) -> int:
        return self.registers[address]


def test_a_picture_of_another_exposure_that_comes_late_is_not_sent() -> None:
    machine = Bare(fresh=True)
    assert machine._request_pictures(1000, 0.0) is None
    assert machine._request_pictures(2000, 0.0) is None
    first, second = machine.wanted
    assert (first["us"], second["us"]) == (1000, 2000)
    later = threading.Timer(0.1, machine.receive_pictures, ([0], first))
    right = threading.Timer(0.3, machine.receive_pictures, ([4096], second))
    later.start()
    right.start()
    assert machine._request_pictures(2000, 20.0) == [4096]
    later.join()
    right.join()


def test_a_picture_that_comes_late_is_sent_if_it_is_what_is_asked_for() -> None:
    machine = Bare(fresh=False)
    assert machine._request_pictures(1000, 0.0) is None
    machine.receive_pictures([8192], machine.wanted[0])
    assert machine._request_pictures(1000, 0.0) == [8192]
    assert len(machine.wanted) == 1
    machine._memory[:8] = (1).to_bytes(8, "little")
    assert machine._request_pictures(1000, 0.0) is None
    machine.receive_pictures([8192], machine.wanted[0])
    assert machine._request_pictures(1000, 0.0) is None
