"""USB wheels on a simulated bus, with all that goes over the wire written down."""

import numpy as np
from figures.usb_cases import USB_CASES

from drivers.interfaces import Surroundings
from simulator.clock import VirtualClock
from simulator.wire.usb_backend import UsbBus, register_bus, unregister_bus

SEVEN = [[400 + 10 * i, 5] for i in range(7)]


class Bench:
    """A bus with one machine, and drivers that find it."""

    def __init__(self, machine, seed=0):
        self.clock = VirtualClock()
        self.machine = machine
        self.bus = UsbBus(self.clock, seed)
        self.plug = self.bus.plug_in(machine)
        self.backend = register_bus(f"bench {id(self)}", self.bus)
        self.surroundings = Surroundings(self.clock)
        self.sent = []
        """Reports from the host, and what the device gives back, as they went."""
        self._listen()

    def _listen(self):
        control, read = self.plug.control, self.plug.read

        def heard_control(setup, data, timeout):
            answer = control(setup, data, timeout)
            # Its strings are pyusb's own affair.
            if setup.request_type != 0x80:
                self.sent.append((setup[:4], data or setup.length, answer))
            return answer

        def heard_read(endpoint, length, timeout):
            data = read(endpoint, length, timeout)
            self.sent.append((endpoint, length, data))
            return data

        self.plug.control, self.plug.read = heard_control, heard_read

    @property
    def place(self):
        """Where the wheel really stands; 0 while it turns."""
        return self.machine.wheel.reported_slot(self.clock.now())

    def wait(self, seconds):
        self.clock.wait_until(self.clock.now() + seconds, lambda: False)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        unregister_bus(self.backend.partition("@")[2])


COMMANDS = {name: asked for name, asked in USB_CASES[0].commands.items() if name != "open"}


def ask(wheel, name):
    """One of COMMANDS; DeviceError."""
    return COMMANDS[name].run(wheel, np.random.default_rng(4))


def recover(bench, wheel):
    """What was strange has ended: the next command works."""
    to = 1 + wheel.slot % 7
    assert wheel.set_slot(to).actual == to == bench.place
    assert wheel.slot == to
