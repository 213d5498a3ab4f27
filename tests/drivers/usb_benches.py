"""USB wheels on a simulated bus, with all that goes over the wire written down."""

import random

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from simulator.clock import VirtualClock
from simulator.wire.usb_backend import UsbBus, register, unregister

SEVEN = [[400 + 10 * i, 5] for i in range(7)]


class Bench:
    """A bus with one machine, and drivers that find it."""

    def __init__(self, machine, seed=0):
        self.clock = VirtualClock()
        self.machine = machine
        self.bus = UsbBus(self.clock, seed)
        self.plug = self.bus.plug_in(machine)
        self.backend = register(f"bench {id(self)}", self.bus)
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
        return self.machine.wheel.stands(self.clock.now())

    def wait(self, seconds):
        self.clock.wait_until(self.clock.now() + seconds, lambda: False)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        unregister(self.backend.partition("@")[2])


COMMANDS = {
    "slot": lambda wheel: wheel.slot,
    "wavelength": lambda wheel: wheel.wavelength,
    "bandwidth": lambda wheel: wheel.bandwidth,
    "set slot": lambda wheel: wheel.set_slot(4),
    "set wavelength": lambda wheel: wheel.set_wavelength(450e-9),
    "make safe": lambda wheel: wheel.make_safe(),
    "health": lambda wheel: wheel.health(),
    "leave": lambda wheel: wheel.__exit__(None, None, None),
}


def is_right(name, answer, place):
    """Whether an answer is what the wheel really did."""
    match name:
        case "slot":
            return answer == place
        case "wavelength":
            return round(answer * 1e9) == 390 + 10 * place
        case "set slot":
            return answer.actual == place == 4
        case "set wavelength":
            return round(answer.actual * 1e9) == 450 and place == 6
        case "make safe" | "leave":
            return place == 1
        case "health":
            return answer["slot"] == (str(place) if place else "turning")
    return True


def suffer(bench, wheel, fault, name):
    """A command under a fault: right, or a DeviceError, and in time either way."""
    bench.plug.inject(fault)
    began = bench.clock.now()
    try:
        answer = COMMANDS[name](wheel)
    except DeviceError as error:
        answer = error
    else:
        assert is_right(name, answer, bench.place), (name, answer, bench.place)
    assert bench.clock.now() - began <= wheel.reply_time + 1
    return answer


def recover(bench, wheel, name):
    """The fault has gone: the next command works."""
    bench.plug.mend()
    if name == "leave":
        wheel.__enter__()
    to = random.Random(bench.clock.now()).randint(1, 7)
    began = bench.clock.now()
    assert wheel.set_slot(to).actual == to == bench.place
    assert wheel.slot == to
    assert bench.clock.now() - began <= 2 * wheel.reply_time
