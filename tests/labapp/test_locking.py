import hashlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from datetime import date

import forked
import pytest

import labapp.bench.driver_loading
import labapp.bench.opening
from drivers.interfaces import Identity
from labapp.bench import locking
from labapp.bench.locking import device_names, lock_devices, lock_serial_number
from labapp.bench.opening import open_bench
from labapp.common import named_locks
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, DeviceTable
from labapp.files.reading import read_file
from simulator.screens import NoXServer, xvfb

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""

OWNER = """
import sys, warnings; sys.argv[:] = ["/usr/bin/labapp", "run", "plan.toml", "--fast"]
warnings.simplefilter("error")
from pathlib import Path
from labapp.files.bench_file import BenchFile
from labapp.files.reading import read_file
from labapp.bench import locking
from labapp.bench.locking import lock_devices
locking._PREFIX = {prefix!r}
with lock_devices(read_file(Path({bench!r}), BenchFile).devices.tables):
    {then}
    print("locked", flush=True)
    sys.stdin.readline()
print("free", flush=True)
sys.stdin.readline()
"""


LEAVING_SOMEBODY = (
    "import subprocess; subprocess.Popen([sys.executable, '-c', 'import sys; sys.stdin.read()'], "
    "close_fds=False, stdout=subprocess.DEVNULL)"
)
"""Of whom it is known that they end: when the tests' end of the pipe is closed."""


@pytest.fixture(autouse=True)
def prefix(monkeypatch):
    """What the names of the locks begin with, of this test alone."""
    name = f"test-{secrets.token_hex(8)}"
    monkeypatch.setattr(locking, "_PREFIX", name)
    yield name
    # Of processes that were killed, the files stay until somebody takes the lock again.
    for folder in named_locks._folders():
        for file in folder.glob(f"*-{name}-*"):
            file.unlink()


@pytest.fixture
def bench(small):
    """Write a bench file; devices are given as the text of their tables. Its path."""

    def write(name="real", **devices):
        text = small.bench.read_text()
        for role, table in devices.items():
            text = text.replace(f'driver = "simulated-{role}"', table)
        path = small.folder / f"{name}.toml"
        path.write_text(text)
        return path

    return write


ACME = 'driver = "acme-camera"\noptions = { serial = "7", gain = 2 }'


def locked(path):
    return lock_devices(read_file(path, BenchFile).devices.tables)


def is_free(path):
    try:
        with locked(path):
            return True
    except UserError:
        return False


class Owner:
    """Another process, `labapp run plan.toml --fast`, that has the devices of a bench."""

    def __init__(self, prefix, bench, then="pass"):
        self.process = forked.Popen(
            [sys.executable, "-c", OWNER.format(prefix=prefix, bench=str(bench), then=then)],
            stdin=forked.PIPE,
            stdout=forked.PIPE,
            text=True,
        )
        self.read("locked")

    def read(self, word):
        assert self.process.stdout.readline() == f"{word}\n"

    def kill(self):
        self.process.kill()
        self.process.communicate(timeout=PATIENCE)


@pytest.fixture
def owner(prefix):
    owners = []

    def begin(bench, then="pass"):
        owners.append(Owner(prefix, bench, then))
        return owners[-1]

    yield begin
    for one in owners:
        one.kill()


def test_who_comes_second_is_told_who_has_the_device(bench, prefix):
    path = bench(camera=ACME)
    code = OWNER.format(prefix=prefix, bench=str(path), then="pass")
    # A forked process would have the command of the one that it was forked from.
    command = [sys.executable, "-c", code, "/usr/bin/labapp", "run", "\x1b[2Jµm.toml", "--fast"]
    with subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": "/nowhere"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "locked\n"
        words = (
            r"^the camera \(acme-camera\) is in use by labapp run \?\[2Jµm\.toml "
            rf"\(process {process.pid}\)\. Close that first\.$"
        )
        with pytest.raises(UserError, match=words), locked(path):
            pass
        process.communicate("\n\n", timeout=PATIENCE)
    assert is_free(path)


def test_a_bench_in_use_is_not_opened(bench, owner, small, monkeypatch):
    class Acme:
        name = value = "acme-camera"

        @staticmethod
        def load():
            raise AssertionError("its driver was loaded")

    path = bench(camera=ACME)
    owner(path)
    known = {**labapp.bench.driver_loading.installed_drivers(), "acme-camera": Acme}
    monkeypatch.setattr(labapp.bench.driver_loading, "installed_drivers", lambda: known)
    files = labapp.bench.opening.BenchFiles(path, small.scene)
    with (
        pytest.raises(UserError, match=r"the camera .* is in use by .* \(process \d+\)"),
        open_bench(files),
    ):
        pass


def test_a_device_is_free_when_its_owner_has_closed_it(bench, owner):
    path = bench(camera=ACME)
    other = owner(path)
    assert not is_free(path)
    other.process.stdin.write("\n")
    other.process.stdin.flush()
    other.read("free")
    assert is_free(path)
    assert other.process.poll() is None


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_device_is_free_when_its_owner_is_killed(number, bench, owner):
    path = bench(camera=ACME)
    process = owner(path).process
    assert not is_free(path)
    process.send_signal(number)
    assert process.wait(PATIENCE) == -number
    assert is_free(path)


def test_a_process_that_its_owner_leaves_behind_does_not_keep_a_device(bench, owner):
    """A hosted device's, say, which makes itself safe when its parent is gone."""
    path = bench(camera=ACME)
    process = owner(path, then=LEAVING_SOMEBODY).process
    process.kill()
    process.wait(PATIENCE)
    assert is_free(path)


def test_a_device_is_free_after_an_error(bench):
    path = bench(camera=ACME)
    with pytest.raises(ZeroDivisionError), locked(path):
        _ = 1 / 0
    assert is_free(path)


def test_even_one_process_opens_a_device_once(bench):
    path = bench(camera=ACME)
    with locked(path):
        mine = rf"the camera .* is in use by .*\(process {os.getpid()}\)"
        with pytest.raises(UserError, match=mine), locked(path):
            pass
        assert not is_free(path)
    assert is_free(path)


def test_two_threads_do_not_share_a_device(bench):
    path, found = bench(camera=ACME), []
    with locked(path):
        thread = threading.Thread(target=lambda: found.append(is_free(path)))
        thread.start()
        thread.join(PATIENCE)
    assert found == [False]


def test_an_owner_that_is_not_known_is_another_program(bench, prefix):
    path = bench(camera=ACME)
    with locked(path):
        for folder in named_locks._folders():
            for file in folder.glob(f"*-{prefix}-*"):
                file.write_bytes(b"")
        with pytest.raises(UserError, match="is in use by another program of yours"), locked(path):
            pass
    assert is_free(path)


def test_nothing_of_a_lock_stays_and_a_folder_that_others_may_enter_is_closed(bench, prefix):
    path = bench(camera=ACME)
    for folder in named_locks._folders():
        folder.chmod(0o777)
    with locked(path):
        held = [file for one in named_locks._folders() for file in one.glob(f"*-{prefix}-*")]
        assert len(held) == len(list(named_locks._folders())) > 0
        assert all(file.parent.stat().st_mode & 0o777 == 0o700 for file in held)
        # Who is somebody else's link or file isn't this user's lock.
        assert not any(file.is_symlink() for file in held)
    assert not any(file.exists() for file in held)


def test_without_a_folder_for_locks_that_is_said_and_the_device_opened(bench, monkeypatch, caplog):
    monkeypatch.setattr(named_locks, "_folders", lambda: iter(()))
    path = bench(camera=ACME)
    with locked(path), locked(path):
        assert "there is no folder for locks" in caplog.text


def test_what_is_made_up_or_a_person_needs_no_lock(bench, owner):
    person = 'driver = "manual-targets"\noptions = { names = ["star"] }'
    path = bench(targets=person)
    owner(path)
    with locked(path), locked(path):
        pass


@pytest.mark.parametrize(
    "other",
    [
        'driver = "acme-camera"\noptions = { serial = "8", gain = 2 }',
        'driver = "acme-camera"\noptions = { serial = "7", port = "COM1" }',
        'driver = "acme-camera"\noptions = { serial = 7, gain = 2 }',
        'driver = "acme-camera"',
        'driver = "other-camera"\noptions = { serial = "7", gain = 2 }',
    ],
)
def test_another_driver_or_address_is_another_device(other, bench):
    with locked(bench(camera=ACME)):
        assert is_free(bench("other", camera=other))


@pytest.mark.parametrize(
    "same",
    [
        'driver = "acme-camera"\noptions = { gain = 2, serial = "7" }',
        'driver = "acme-camera"\noptions = { gain = 3, serial = "7" }',
        'driver = "acme-camera"\noptions = { serial = "7" }',
        'driver = "acme-camera"\nown_process = true\noptions = { serial = "7", gain = 2 }',
    ],
)
def test_another_bench_with_the_same_device_waits_for_it(same, bench):
    with locked(bench(camera=ACME)):
        assert not is_free(bench("other", camera=same))


def test_without_an_address_other_options_are_another_device(bench):
    with locked(bench(camera='driver = "acme-camera"\noptions = { channel = 1 }')):
        two = bench("other", camera='driver = "acme-camera"\noptions = { channel = 2 }')
        assert is_free(two)


def test_devices_of_one_bench_are_locked_one_by_one(bench):
    both = bench("both", slm='driver = "acme-slm"', camera=ACME)
    only_slm, only_camera = bench("s", slm='driver = "acme-slm"'), bench("c", camera=ACME)
    with locked(both):
        assert not is_free(only_slm)
        assert not is_free(only_camera)
    with locked(only_camera):
        with pytest.raises(UserError, match=r"the camera .* is in use"), locked(both):
            pass
        # What was had already was let go.
        assert is_free(only_slm)


def test_options_may_be_whatever_a_file_may_hold(bench):
    path = bench(camera='driver = "acme-camera"\noptions = { bought = 2024-06-07 }')
    assert read_file(path, BenchFile).devices.camera.options == {"bought": date(2024, 6, 7)}
    with locked(path):
        assert not is_free(path)


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another user")


@needs_root
def test_what_another_user_holds_without_the_device_keeps_nobody_out(bench, prefix):
    """Neither the lock of its name, nor the abstract socket that was the lock once."""
    path = bench(camera=ACME)
    name = hashlib.sha256(device_names(DeviceTable(**ACME_TABLE))[0].encode()).hexdigest()[:32]
    with socket.socket(socket.AF_UNIX) as squat, as_nobody(prefix) as process:
        squat.bind(f"\0{prefix}-{name}")
        with locked(path):
            assert process.poll() is None
        process.kill()


ACME_TABLE = {"driver": "acme-camera", "options": {"serial": "7", "gain": 2}}


@contextmanager
def as_nobody(prefix):
    """A process of another user that locks a device by the names that the bench file has."""
    names = device_names(DeviceTable(**ACME_TABLE))
    code = (
        "import os, sys; os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "from labapp.bench import locking\n"
        f"locking._PREFIX = {prefix!r}\n"
        f"with locking._lock({names[0]!r}, 'it'):\n"
        "    print('locked', flush=True)\n"
        "    sys.stdin.readline()\n"
    )
    with forked.Popen(
        [sys.executable, "-c", code],
        stdin=forked.PIPE,
        stdout=forked.PIPE,
        stderr=forked.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout.readline() == "locked\n"
        yield process


def test_a_port_is_the_same_by_all_of_its_names_and_to_all_drivers(bench, tmp_path):
    ours, theirs = os.openpty()
    port = os.ttyname(theirs)
    link = tmp_path / "link"
    link.symlink_to(port)
    with locked(bench(filter=f'driver = "varispec"\noptions = {{ port = "{port}" }}')):
        for name, driver in (("link", "varispec"), ("other", "thorlabs-wheel"), ("x", "acme")):
            table = f'driver = "{driver}"\noptions = {{ port = "{link}" }}'
            assert not is_free(bench(name, filter=table))
        assert is_free(bench("ours", filter='driver = "varispec"'))
    for handle in (ours, theirs):
        os.close(handle)


def test_a_device_keeps_its_name_when_it_is_plugged_in_again(bench, tmp_path, monkeypatch):
    """It is another file then, to which the link with its serial number leads."""
    folder = tmp_path / "by-id"
    folder.mkdir()
    files = [tmp_path / f"ttyUSB{number}" for number in range(2)]
    for file in files:
        file.touch()
    monkeypatch.setattr("labapp.bench.locking._LINK_FOLDERS", (str(folder),))
    link = folder / "usb-ACME_7"
    tables = [f'driver = "varispec"\noptions = {{ port = "{file}" }}' for file in files]
    link.symlink_to(files[0])
    with locked(bench(filter=tables[0])):
        assert is_free(bench("other", filter=tables[1]))
        link.unlink()
        link.symlink_to(files[1])
        assert not is_free(bench("again", filter=tables[1]))


def test_what_a_driver_opens_by_default_is_locked_by_its_name(bench):
    with locked(bench(filter='driver = "varispec"')):
        named = 'driver = "varispec"\noptions = { port = "/dev/ttyUSB0" }'
        assert not is_free(bench("named", filter=named))
    with locked(bench(camera='driver = "uvc-camera"\noptions = { device = 0 }')):
        assert not is_free(bench("camera", camera='driver = "uvc-camera"'))


@pytest.mark.parametrize(
    ("ours", "others", "together"),
    [
        (Identity("ACME", "7", simulated=False), Identity("ACME", "7", simulated=False), False),
        (Identity("ACME", "7", simulated=False), Identity("ACME", "8", simulated=False), True),
        (Identity("ACME", "7", simulated=False), Identity("Other", "7", simulated=False), True),
        (Identity("ACME", "", simulated=False), Identity("ACME", "", simulated=False), True),
        (Identity("ACME", "7", simulated=True), Identity("ACME", "7", simulated=True), True),
    ],
)
def test_a_serial_number_is_a_devices_whatever_its_address(ours, others, together):
    table = DeviceTable(driver="acme-camera")

    def both():
        with (
            lock_serial_number("camera", table, ours),
            lock_serial_number("camera", table, others),
        ):
            return True

    if together:
        assert both()
    else:
        with pytest.raises(UserError, match=r"the camera \(acme-camera, ACME 7\) is in use by"):
            both()


def test_a_screen_is_the_same_by_all_of_its_names(bench):
    """By its output, or by its size alone."""
    try:
        with xvfb(320, 200) as server:
            both = [
                f'driver = "screen-slm"\noptions = {{ display = "{display}", width = 320, '
                f"height = 200, allow_primary = true, {screen} }}"
                for display, screen in (
                    (server.display, 'screen = "screen"'),
                    (f"unix{server.display}.0", ""),
                )
            ]
            with locked(bench(slm=both[0])):
                assert not is_free(bench("other", slm=both[1]))
    except NoXServer as error:
        pytest.skip(str(error))
