"""Forked processes are as true ones: every program here gives the same as a fresh Python does."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import forked

PATIENCE = 60

KINDS = pytest.mark.parametrize("kind", [forked, subprocess], ids=["forked", "fresh"])


@pytest.fixture(autouse=True)
def usual_python(monkeypatch):
    """Fresh ones would obey it."""
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)


def python(code, *arguments):
    return [sys.executable, "-c", code, *arguments]


ALL = """
import atexit, os, signal, sys, threading, time
print(input(), __name__, sys.argv)
print(os.listdir("/proc/self/fd"), threading.active_count())
print(signal.getsignal(2) is signal.default_int_handler, sys.stdout.line_buffering)
atexit.register(print, "at exit")
threading.Thread(target=lambda: (time.sleep(.05), print("late"))).start()
sys.exit("why")
"""


@KINDS
def test_a_program_sees_and_says_what_it_should(kind):
    done = kind.run(python(ALL, "one", "2"), input="asked\n", capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "why\n")
    assert done.stdout.splitlines() == [
        "asked __main__ ['-c', 'one', '2']",
        "['0', '1', '2', '3'] 1",
        "True False",
        "late",
        "at exit",
    ]


@KINDS
@pytest.mark.parametrize(
    ("code", "status", "last"),
    [
        ("import sys; sys.exit(3)", 3, ""),
        ("import os; os._exit(4)", 4, ""),
        ("import os; print('lost'); os.kill(os.getpid(), 9)", -signal.SIGKILL, ""),
        ("import signal; signal.raise_signal(2)", -signal.SIGINT, "KeyboardInterrupt"),
        ("1 / 0", 1, "ZeroDivisionError: division by zero"),
    ],
)
def test_a_program_ends_as_it_should(kind, code, status, last):
    done = kind.run(python(code), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (status, "")
    assert "".join(done.stderr.splitlines()[-1:]) == last


@KINDS
def test_what_cannot_be_written_at_the_end_is_an_error(kind):
    with Path("/dev/full").open("w") as full:
        done = kind.run(python("print('lost')"), stdout=full, stderr=kind.PIPE, text=True)
    assert done.returncode == 120
    assert "No space left on device" in done.stderr


@KINDS
def test_signals_are_blocked_as_they_are_here(kind):
    code = python(
        "import signal; print(signal.SIGUSR1 in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    )
    assert kind.run(code, capture_output=True, text=True).stdout == "False\n"
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
    try:
        assert kind.run(code, capture_output=True, text=True).stdout == "True\n"
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def test_modules_run_as_the_interpreter_runs_them():
    done = forked.run(
        [sys.executable, "-m", "labapp", "--help"], capture_output=True, text=True, check=True
    )
    assert "labapp" in done.stdout


def test_the_application_is_found_where_its_tests_are_on_the_path():
    tests = str(Path(__file__).parents[1])
    code = "import sys, forked; forked.run([sys.executable, '-m', 'labapp', '--version'])"
    done = subprocess.run(
        python(code), env=os.environ | {"PYTHONPATH": tests}, capture_output=True, text=True
    )
    assert done.stdout.startswith("labapp "), done.stderr


@KINDS
def test_it_has_its_own_folder_and_environment(kind, tmp_path):
    (tmp_path / "mine.py").write_text("word = 'from a module beside'")
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "yours.py").write_text("word = 'and on the path'")
    code = "import os, mine, yours; print(os.getcwd(), sorted(os.environ), mine.word, yours.word)"
    environment = {"PYTHONPATH": str(tmp_path / "path"), "LC_CTYPE": "C.UTF-8"}
    output = kind.run(
        python(code), cwd=tmp_path, env=environment, capture_output=True, text=True
    ).stdout
    assert output == f"{tmp_path} {sorted(environment)} from a module beside and on the path\n"


@KINDS
@pytest.mark.parametrize(
    ("options", "groups"),
    [
        ({}, "False False"),
        ({"process_group": 0}, "True False"),
        ({"start_new_session": True}, "True True"),
    ],
)
def test_it_is_a_child_in_the_group_that_is_asked_for(kind, options, groups):
    code = (
        "import os; print(os.getppid(), os.getpgid(0) == os.getpid(), os.getsid(0) == os.getpid(), "
        "flush=True); os._exit(0)"
    )
    done = kind.run(python(code), capture_output=True, text=True, **options)
    assert done.stdout == f"{os.getpid()} {groups}\n"


@pytest.fixture
def as_at_a_terminal():
    """Processes begin as at a terminal, also where these tests run after nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@KINDS
@pytest.mark.usefixtures("as_at_a_terminal")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_it_is_killed_by_signals(kind, number):
    with kind.Popen(
        python("print(flush=True); import time; time.sleep(1000)"), stdout=-1
    ) as process:
        assert process.stdout.readline() == b"\n"
        assert process.poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.01)
        process.send_signal(number)
        assert process.wait(PATIENCE) == -number


@KINDS
def test_ctrl_c_at_a_terminal_interrupts_it(kind):
    code = """
import fcntl, os, sys, termios, time
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
try:
    print(all(map(os.isatty, range(3))), sys.stdout.line_buffering)
    time.sleep(1000)
except KeyboardInterrupt:
    print("interrupted")
"""
    master, slave = pty.openpty()
    with kind.Popen(
        python(code), stdin=slave, stdout=slave, stderr=slave, start_new_session=True
    ) as process:
        os.close(slave)
        assert os.read(master, 100) == b"True True\r\n"
        os.write(master, b"\x03")
        assert process.wait(PATIENCE) == 0
    assert b"interrupted" in os.read(master, 100)
    os.close(master)


@KINDS
def test_it_gets_the_files_that_are_passed_and_no_other(kind, tmp_path):
    with (tmp_path / "file").open("w") as file, (tmp_path / "other").open("w") as other:
        os.set_inheritable(other.fileno(), True)
        code = (
            f"import os; os.write({file.fileno()}, b'written')\n"
            f"try: os.write({other.fileno()}, b'written')\n"
            "except OSError: print('closed')"
        )
        done = kind.run(python(code), pass_fds=[file.fileno()], capture_output=True, text=True)
    assert done.stdout == "closed\n"
    assert (tmp_path / "file").read_text() == "written"


def test_its_processor_time_is_counted_with_that_of_other_children():
    before = sum(os.times()[2:4])
    forked.run(python("import time\nwhile time.process_time() < .3: pass"), check=True)
    assert sum(os.times()[2:4]) - before >= 0.3


def test_who_forks_has_loaded_torch_and_has_one_thread():
    done = forked.run(python("import sys; print(*sys.modules)"), capture_output=True, text=True)
    modules = done.stdout.split()
    status = Path(f"/proc/{forked._server()._process.pid}/status").read_text()
    assert "torch" in modules
    assert "PySide6" not in modules
    assert "Threads:\t1\n" in status


def test_all_end_with_those_who_asked_for_them():
    code = """
import forked, sys
forked.LOADED = ()
process = forked.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
print(forked._server()._process.pid, process.pid, flush=True)
sys.stdin.read()
"""
    places = {"PYTHONPATH": str(Path(__file__).parents[1])}
    with subprocess.Popen(
        python(code), stdin=-1, stdout=-1, env={**os.environ, **places}
    ) as process:
        started = [os.pidfd_open(int(number)) for number in process.stdout.readline().split()]
        process.kill()
    for one in started:
        ended, _, _ = select.select([one], [], [], PATIENCE)
        os.close(one)
        assert ended


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        (["ls"], {}),
        ([sys.executable, "file.py"], {}),
        ([sys.executable, "-W", "error"], {}),
        ([sys.executable, "-c", ""], {"shell": True}),
        ([sys.executable, "-c", ""], {"close_fds": False}),
    ],
)
def test_what_cannot_be_forked_is_refused(arguments, options):
    with pytest.raises(ValueError):
        forked.Popen(arguments, **options)
