import fcntl
import os
import re
import signal
import sys
import tempfile
import threading
from datetime import date
from pathlib import Path

import forked
import pytest

import labapp.bench.opening
from labapp.bench.locking import lock_devices
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile
from labapp.files.reading import read_file

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""

OWNER = """
import sys, warnings; sys.argv[:] = ["/usr/bin/labapp", "run", "plan.toml", "--fast"]
warnings.simplefilter("error")
from pathlib import Path
from labapp.files.bench_file import BenchFile
from labapp.files.reading import read_file
from labapp.bench.locking import lock_devices
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


@pytest.fixture
def locks(tmp_path, monkeypatch):
    """The folder of locks, of this test alone."""
    folder = tmp_path / "locks"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


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

    def __init__(self, locks, bench, then="pass"):
        self.process = forked.Popen(
            [sys.executable, "-c", OWNER.format(bench=str(bench), then=then)],
            stdin=forked.PIPE,
            stdout=forked.PIPE,
            env={**os.environ, "TMPDIR": str(locks)},
            text=True,
        )
        self.read("locked")

    def read(self, word):
        assert self.process.stdout.readline() == f"{word}\n"

    def kill(self):
        self.process.kill()
        self.process.communicate(timeout=PATIENCE)


@pytest.fixture
def owner(locks):
    owners = []

    def begin(bench, then="pass"):
        owners.append(Owner(locks, bench, then))
        return owners[-1]

    yield begin
    for one in owners:
        one.kill()


def test_who_comes_second_is_told_who_has_the_device(bench, owner):
    path = bench(camera=ACME)
    process = owner(path).process.pid
    words = (
        rf"^the camera \(acme-camera\) is in use by labapp run plan\.toml "
        rf"\(process {process}, since \d\d:\d\d\)\. Close that first\.$"
    )
    with pytest.raises(UserError, match=words), locked(path):
        pass


def test_a_bench_in_use_is_not_opened(bench, owner, small, monkeypatch):
    class Acme:
        name = value = "acme-camera"

        @staticmethod
        def load():
            raise AssertionError("its driver was loaded")

    path = bench(camera=ACME)
    owner(path)
    known = {**labapp.bench.opening.installed_drivers(), "acme-camera": Acme}
    monkeypatch.setattr(labapp.bench.opening, "installed_drivers", lambda: known)
    files = labapp.bench.opening.BenchFiles(path, small.scene)
    with (
        pytest.raises(UserError, match=r"the camera .* is in use by labapp run"),
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


def test_a_device_is_free_after_an_error(bench, locks):
    path = bench(camera=ACME)
    with pytest.raises(ZeroDivisionError), locked(path):
        _ = 1 / 0
    assert is_free(path)


def test_even_one_process_opens_a_device_once(bench, locks):
    path = bench(camera=ACME)
    with locked(path):
        mine = rf"the camera .* is in use by .*\(process {os.getpid()}, "
        with pytest.raises(UserError, match=mine), locked(path):
            pass
        assert not is_free(path)
    assert is_free(path)


def test_two_threads_do_not_share_a_device(bench, locks):
    path, found = bench(camera=ACME), []
    with locked(path):
        thread = threading.Thread(target=lambda: found.append(is_free(path)))
        thread.start()
        thread.join(PATIENCE)
    assert found == [False]


def test_the_last_owner_is_named_and_not_the_one_before(bench, locks, monkeypatch):
    path = bench(camera=ACME)
    for arguments in (["/usr/bin/labapp", "run", "a very long name.toml"], ["x"]):
        monkeypatch.setattr(sys, "argv", arguments)
        with locked(path):
            name = " ".join([Path(arguments[0]).name, *arguments[1:]])
            words = rf"in use by {re.escape(name)} \(process \d+, since \d\d:\d\d\)\. Close"
            with pytest.raises(UserError, match=words), locked(path):
                pass


def test_an_owner_that_has_not_said_its_name_yet_is_another_application(bench, locks):
    path = bench(camera=ACME)
    with locked(path):
        pass
    (file,) = locks.iterdir()
    with file.open("r+") as lock:
        lock.truncate(0)
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(UserError, match="is in use by another application"), locked(path):
            pass


@pytest.mark.parametrize("name", ["µm-plan.toml", "\udcff.toml"])
def test_an_owner_may_have_any_name(name, bench, locks, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["labapp", "run", name])
    path = bench(camera=ACME)
    with locked(path):
        assert not is_free(path)


def test_what_is_made_up_or_a_person_needs_no_lock(bench, owner, locks):
    person = 'driver = "manual-targets"\noptions = { names = ["star"] }'
    path = bench(targets=person)
    owner(path)
    with locked(path), locked(path):
        assert list(locks.iterdir()) == []


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
def test_another_driver_or_address_is_another_device(other, bench, locks):
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
def test_another_bench_with_the_same_device_waits_for_it(same, bench, locks):
    with locked(bench(camera=ACME)):
        assert not is_free(bench("other", camera=same))


def test_without_an_address_other_options_are_another_device(bench, locks):
    with locked(bench(camera='driver = "acme-camera"\noptions = { channel = 1 }')):
        two = bench("other", camera='driver = "acme-camera"\noptions = { channel = 2 }')
        assert is_free(two)


def test_devices_of_one_bench_are_locked_one_by_one(bench, locks):
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


def test_options_may_be_whatever_a_file_may_hold(bench, locks):
    path = bench(camera='driver = "acme-camera"\noptions = { bought = 2024-06-07 }')
    assert read_file(path, BenchFile).devices.camera.options == {"bought": date(2024, 6, 7)}
    with locked(path):
        assert not is_free(path)


def test_everybody_on_the_computer_may_lock(bench, locks):
    before = os.umask(0o077)
    try:
        assert is_free(bench(camera=ACME))
    finally:
        os.umask(before)
    (file,) = locks.iterdir()
    assert file.stat().st_mode & 0o777 == 0o666


def test_a_lock_that_is_no_file_is_not_written_through(bench, locks, tmp_path):
    """In a folder for all, anybody may have put it there."""
    path = bench(camera=ACME)
    assert is_free(path)
    (file,) = locks.iterdir()
    treasure = tmp_path / "treasure"
    treasure.write_text("gold")
    file.unlink()
    file.symlink_to(treasure)
    words = rf"the camera \(acme-camera\) can't be locked: {file}: .*Remove that file when nobody"
    with pytest.raises(UserError, match=words), locked(path):
        pass
    assert treasure.read_text() == "gold"
