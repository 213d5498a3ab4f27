"""The CS-2000's machine, against its communication specifications, rev. 7.00."""

import struct

import numpy as np
import pytest

from simulator.machines.cs2000 import CS2000Machine
from simulator.machines.cs2000_settings import WAVELENGTHS
from simulator.wire import SimulatedLine


def flat(wavelengths):
    """0.001 W/(sr m² nm) at all wavelengths, about 73 cd/m²."""
    return np.full(len(wavelengths), 1e6)


class Computer:
    """What is sent, and all that comes in the time after."""

    def __init__(self, spectrum=flat, **options) -> None:
        self.machine = CS2000Machine(spectrum, **options)
        self.line = SimulatedLine(self.machine, baudrate=115200)
        self.now = 0.0

    def say(self, data, seconds=0.5):
        self.line.send(data, self.now)
        self.now += seconds
        return self.line.receive(self.now)


@pytest.fixture
def remote():
    computer = Computer()
    assert computer.say(b"RMTS,2\r") == b"OK00\r"
    return computer


def test_but_for_remote_mode_it_takes_no_command():
    computer = Computer()
    assert computer.say(b"IDDR\r") == b"ER00\r"
    assert computer.say(b"RMTS,1\r") == b"OK00\r"
    assert computer.say(b"IDDR\r") == b"OK00,CS-2000A ,2,1000123\r"
    assert computer.say(b"RMTS,0\r") == b"OK00\r"
    assert computer.say(b"SPMR\r") == b"ER00\r"


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n"])
def test_it_ends_its_answers_as_it_was_told(end):
    computer = Computer()
    assert computer.say(b"RMTS,1" + end) == b"OK00" + end
    assert computer.say(b"STSR" + end) == b"OK00,0" + end


def test_a_command_without_an_end_is_dropped_after_a_minute(remote):
    assert remote.say(b"STSR", 59.0) == b""
    assert remote.say(b"\r") == b"OK00,0\r"
    assert remote.say(b"ST", 61.0) == b""
    assert remote.say(b"IDDR\r") == b"OK00,CS-2000A ,2,1000123\r"


def test_the_oldest_firmware_says_that_it_has_dropped_one():
    computer = Computer(model="CS-2000", firmware="1.01.0000")
    computer.say(b"RMTS,1\r")
    computer.say(b"ST", 61.0)
    assert computer.say(b"IDDR\r") == b"ER00\rOK00,CS-2000  ,1,1000123\r"


def test_old_firmware_lacks_the_mode_that_spares_the_flash():
    computer = Computer(firmware="3.00.0000")
    assert computer.say(b"RMTS,2\r") == b"ER17\r"
    computer.say(b"RMTS,1\r")
    computer.say(b"NDFS,1\r")
    assert computer.machine.settings.flash_write_count == 1


def test_the_mode_that_spares_the_flash_does(remote):
    remote.say(b"NDFS,1\rSPMS,1,2\rSCMS,2\r")
    assert remote.machine.settings.flash_write_count == 0


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (b"SPMR\r", b"OK00,0,2\r"),
        (b"SPMS,1\rSPMR\r", b"OK00\rOK00,1,2\r"),
        (b"SPMS,0,1\rSPMR\r", b"OK00\rOK00,0,1\r"),
        (b"SPMS,2,8\rSPMR\r", b"OK00\rOK00,2,08,2\r"),
        (b"SPMS,4,16,0\rSPMR\r", b"OK00\rOK00,4,16,0\r"),
        (b"SPMS,3,5000,1\rSPMR\r", b"OK00\rOK00,3,000005000,1\r"),
        (b"SPMS,0,1,1\r", b"ER00\r"),
        (b"SPMS,3,5000\r", b"ER00\r"),
        (b"SPMS,3,5000,2\r", b"ER17\r"),
        (b"SPMS,3,4999,0\r", b"ER17\r"),
        (b"SPMS,2,17\r", b"ER17\r"),
        (b"SPMS,5\r", b"ER17\r"),
        (b"SPMS\r", b"ER00\r"),
        (b"SCMR\r", b"OK00,0\r"),
        (b"SCMS,1,6000\rSCMR\r", b"OK00\rOK00,1,06000\r"),
        (b"SCMS,2\rSCMR\r", b"OK00\rOK00,2\r"),
        (b"SCMS,1\r", b"ER00\r"),
        (b"SCMS,1,1999\r", b"ER17\r"),
        (b"NDFS,2\rNDFR\r", b"OK00\rOK00,2\r"),
        (b"NDFS,3\r", b"ER17\r"),
        (b"LNSS,1\rLNSR\r", b"OK00\rOK00,1\r"),
        (b"OBSS,1\rOBSR\r", b"OK00\rOK00,1\r"),
        (b"MSWE,1\r", b"OK00\r"),
        (b"MSWE,2\r", b"ER17\r"),
        (b"MSWE\r", b"ER00\r"),
        (b"MEAS,0\r", b"ER17\r"),
        (b"MEDR,1,1,1\r", b"ER20\r"),
        (b"MEDR,1,1\r", b"ER00\r"),
        (b"MEDR,1,1,5\r", b"ER17\r"),
        (b"ABCD\r", b"ER00\r"),
        (b"seen\r", b"ER00\r"),
        (b"\r", b"ER00\r"),
        (b"NDFS,a\r", b"ER17\r"),
    ],
)
def test_each_command_byte_for_byte(remote, said, told):
    assert remote.say(said) == told


def test_the_oldest_firmware_has_another_speed_mode():
    computer = Computer(model="CS-2000", firmware="1.01.0000")
    computer.say(b"RMTS,1\r")
    assert computer.say(b"SPMS,0,2\r") == b"ER00\r"
    assert computer.say(b"SPMS,2,8\rSPMR\r") == b"OK00\rOK00,2,08\r"
    assert computer.say(b"SPMS,4,8\r") == b"ER17\r"


def test_a_measurement_has_two_answers(remote):
    assert remote.say(b"MEAS,1\r", 0.9) == b""
    assert remote.say(b"", 0.2) == b"OK00,003\r"
    assert remote.say(b"MEDR,0,0,1\r") == b"ER02\r"
    assert remote.say(b"STSR\r") == b"ER00\r"
    assert remote.say(b"MEAS,1\r") == b"ER17\r"
    assert remote.say(b"", 2.0) == b"OK00\r"
    told = remote.say(b"MEDR,0,0,1\r")
    assert (told[:9], told[18:]) == (b"OK00,0,0,", b",0,0,0,0,00\r")
    # The sum of the CIE's efficiencies is 106.857 nm.
    assert int(told[9:18]) == pytest.approx(2e6 / (0.683 * 106.857), rel=2e-3)


def test_no_command_is_taken_in_the_pre_measurement(remote):
    assert remote.say(b"MEAS,1\rSTSR\rMEAS,0\r", 0.9) == b""
    assert remote.say(b"", 5.0) == b"OK00,003\rOK00\r"


def test_a_measurement_can_be_cancelled(remote):
    remote.say(b"MEAS,1\r", 1.5)
    assert remote.say(b"MEAS,0\r", 10.0) == b"OK00\r"
    assert remote.say(b"MEDR,0,0,1\r") == b"ER20\r"


def test_escape_breaks_a_measurement_off_and_then_leaves_remote_mode(remote):
    remote.say(b"MEAS,1\r", 1.5)
    remote.machine.press_escape()
    assert remote.say(b"", 10.0) == b""
    assert remote.say(b"STSR\r") == b"OK00,0\r"
    remote.machine.press_escape()
    assert remote.say(b"STSR\r") == b"ER00\r"


def test_blocks_as_text_and_in_hexadecimal(remote):
    remote.say(b"MEAS,1\r", 10.0)
    for number, count in ((1, 100), (2, 100), (3, 100), (4, 101)):
        text = b"OK00" + b",1.0000e-3" * count + b"\r"
        assert remote.say(b"MEDR,1,0,%d\r" % number) == text
        digits = struct.pack(">f", 1e-3).hex().upper().encode()
        assert remote.say(b"MEDR,1,1,%d\r" % number) == b"OK00" + (b"," + digits) * count + b"\r"


def test_colours_of_equal_energy(remote):
    remote.say(b"MEAS,1\r", 10.0)
    xyz = remote.say(b"MEDR,2,0,1\r").decode()
    assert xyz.startswith("OK00,7.2")
    assert xyz.count("e+1") == 3
    code, x, y, luminance = remote.say(b"MEDR,2,0,02\r").decode().strip().split(",")
    assert (code, x, y) == ("OK00", "0.3331", "0.3336")
    assert len(luminance) == 6
    assert float(luminance) == pytest.approx(73.0, abs=0.1)
    assert remote.say(b"MEDR,2,0,100\r") == b"OK00,4.0100e-1\r"
    everything = remote.say(b"MEDR,2,0,0\r").decode().strip().split(",")
    assert len(everything) == 25
    # A distance above the locus has its sign, and four decimals.
    assert everything[11] == "-0.0044"


def test_what_can_not_be_computed_has_the_number_of_an_error():
    computer = Computer(lambda w: np.zeros(len(w)))
    computer.say(b"RMTS,2\rSPMS,1\r")
    computer.say(b"MEAS,1\r", 60.0)
    assert computer.say(b"MEDR,2,0,2\r") == b"OK00,-9.999,-9.999,0.0000\r"
    assert computer.say(b"MEDR,2,0,4\r") == b"OK00,-9999,-9.9999,0.0000\r"
    assert computer.say(b"MEDR,2,1,4\r") == b"OK00,D1BA43B6,D1BA43B6,00000000\r"
    assert computer.say(b"MEDR,1,0,1\r") == b"OK00" + b",0.0000e-9" * 100 + b"\r"


def test_with_its_key_enabled_what_was_read_is_gone(remote):
    remote.say(b"MSWE,1\r")
    remote.machine.press_measure(remote.now)
    assert remote.say(b"", 20.0) == b""
    for number in (1, 2, 3, 4):
        assert remote.say(b"MEDR,1,1,%d\r" % number).startswith(b"OK00,")
    assert remote.say(b"MEDR,1,1,1\r") == b"ER20\r"


def test_the_darker_it_is_the_longer_it_takes():
    dim = Computer(lambda w: flat(w) * 1e-3)
    dim.say(b"RMTS,2\r")
    assert dim.say(b"MEAS,1\r", 2.7) == b""
    assert dim.say(b"", 0.1) == b"OK00,057\r"
    assert dim.say(b"", 56.8) == b""
    assert dim.say(b"", 0.3) == b"OK00\r"


def test_too_bright_is_an_error_and_a_smaller_field_takes_it():
    bright = Computer(lambda w: flat(w) * 100)
    bright.say(b"RMTS,2\r")
    assert bright.say(b"MEAS,1\r", 20.0) == b"ER10\r"
    bright.machine.optics.angle = 1
    assert bright.say(b"MEAS,1\r", 20.0).startswith(b"OK00,0")
    assert bright.say(b"MEDR,0,0,1\r")[-6:] == b",1,00\r"


def test_an_external_filter_is_made_up_for_where_it_was_told_of(remote):
    remote.machine.optics.attached_nd = 1
    remote.say(b"MEAS,1\r", 20.0)
    assert remote.say(b"MEDR,1,0,1\r")[:15] == b"OK00,1.0000e-4,"
    remote.say(b"NDFS,1\r")
    remote.say(b"MEAS,1\r", 20.0)
    assert remote.say(b"MEDR,1,0,1\r")[:15] == b"OK00,1.0000e-3,"


def test_its_slit_makes_a_line_five_nanometres_wide():
    def line(wavelengths):
        return np.where(np.abs(wavelengths - 532e-9) < 0.5e-9, 1e7, 0.0)

    computer = Computer(line)
    computer.say(b"RMTS,2\rMEAS,1\r", 100.0)
    values = computer.machine.measured_radiance
    assert values.sum() == pytest.approx(1e-2)
    half = WAVELENGTHS[values >= values.max() / 2]
    assert half[-1] - half[0] == pytest.approx(4e-9)


def test_faults_of_its_own(remote):
    remote.machine.set_fault("stuck")
    assert remote.say(b"MEAS,1\r", 20.0) == b"ER81\r"
    remote.machine.set_fault(None)
    remote.machine.set_fault("error code")
    assert remote.say(b"STSR\r") == b"ER99\r"
    remote.machine.set_fault(None)
    remote.machine.set_fault("busy forever")
    assert remote.say(b"MEAS,1\r", 300.0) == b"OK00,003\r"
    assert remote.say(b"MEDR,0,0,1\r") == b"ER02\r"


@pytest.mark.parametrize("options", [{"model": "CS-1000"}, {"serial": "12"}])
def test_an_instrument_that_can_not_be_is_refused(options):
    with pytest.raises(ValueError, match=r"(model|serial) is"):
        CS2000Machine(flat, **options)
