"""X servers that are started here belong to this user's programs, and to nobody else's."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import time

import pytest

from drivers.x11 import XConnection, XError
from simulator.screens import NoXServer, xvfb
from simulator.screens.server import (
    Entry,
    authority_file,
    published_cookie,
    read_entries,
    running_server,
    server_cookie,
)

COOKIE = bytes(range(16))

OTHERS = [
    Entry(256, b"other-host", b"0", b"MIT-MAGIC-COOKIE-1", b"0123456789abcdef"),
    Entry(0, bytes([10, 0, 0, 1]), b"99", b"XDM-AUTHORIZATION-1", b"\0" * 24),
]


@pytest.fixture(autouse=True)
def authority(tmp_path, monkeypatch):
    path = tmp_path / "authority"
    monkeypatch.setenv("XAUTHORITY", str(path))
    return path


@pytest.fixture
def server(authority):
    try:
        with xvfb(64, 48) as running:
            yield running
    except NoXServer as error:
        pytest.skip(str(error))


def test_this_users_programs_read_the_screen(server):
    with XConnection(server.display) as x:
        assert x.setup.depth == 24
    assert server.pixels().shape == (48, 64, 3)


def test_without_the_cookie_nobody_connects_not_even_this_user(server, tmp_path, monkeypatch):
    monkeypatch.setenv("XAUTHORITY", str(tmp_path / "none"))
    with pytest.raises(XError, match="no X server answers"):
        XConnection(server.display)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another user")
@pytest.mark.parametrize("command", [["xwd", "-root", "-silent"], ["xsetroot", "-solid", "red"]])
def test_another_user_neither_reads_nor_draws(server, authority, command):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} isn't installed")
    before = server.pixels()
    for file in ("/nowhere", str(authority)):
        done = subprocess.run(
            command,
            user=65534,
            group=65534,
            extra_groups=[],
            env={**os.environ, "DISPLAY": server.display, "XAUTHORITY": file, "HOME": "/nowhere"},
            capture_output=True,
            check=False,
            cwd="/",
        )
        assert done.returncode != 0
        assert done.stdout == b""
    assert (server.pixels() == before).all()


def test_the_files_are_for_this_user_alone_and_the_servers_is_removed(tmp_path, authority):
    with server_cookie(tmp_path) as (file, cookie), published_cookie(":7", cookie):
        for one in (file, authority):
            assert stat.S_IMODE(one.stat().st_mode) == 0o600
        (entry,) = read_entries(file.read_bytes())[0]
        assert (entry.kind, entry.data) == (b"MIT-MAGIC-COOKIE-1", cookie)
        assert len(cookie) == 16
    assert not file.exists()
    with server_cookie(tmp_path) as (_, other):
        assert other != cookie


def test_xauth_reads_what_is_written(authority):
    if shutil.which("xauth") is None:
        pytest.skip("xauth isn't installed")
    with published_cookie(":99", COOKIE):
        told = subprocess.run(
            ["xauth", "-f", authority, "list"], capture_output=True, text=True, check=True
        )
    assert told.stdout.split() == [f"{os.uname().nodename}/unix:99", "MIT-MAGIC-COOKIE-1",
                                   COOKIE.hex()]  # fmt: skip


@pytest.mark.parametrize("rest", [b"", b"\1", b"\1\0\0\5abc"])
def test_entries_of_others_stay_as_they_are(authority, rest):
    before = b"".join(entry.encode() for entry in OTHERS) + rest
    authority.write_bytes(before)
    with published_cookie(":99", COOKIE):
        found, tail = read_entries(authority.read_bytes())
        assert [entry for entry in found if entry in OTHERS] == OTHERS
        assert tail == rest
    assert authority.read_bytes() == before


def test_a_cookie_that_a_killed_server_has_left_is_replaced(authority):
    host = os.uname().nodename.encode()
    authority.write_bytes(Entry(256, host, b"99", b"MIT-MAGIC-COOKIE-1", b"old" * 5).encode())
    with published_cookie(":99", COOKIE):
        (entry,) = read_entries(authority.read_bytes())[0]
        assert entry.data == COOKIE


def test_a_lock_that_a_killed_program_has_left_is_broken_and_another_is_waited_for(
    authority, monkeypatch
):
    made, lock = (authority.with_name(f"authority-{end}") for end in "cl")
    made.touch()
    lock.touch()
    monkeypatch.setattr("simulator.screens.server._LOCK_TIMEOUT", 0.1)
    with pytest.raises(OSError, match="locked by another program"), published_cookie(":1", COOKIE):
        pass
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 61)
    with published_cookie(":1", COOKIE):
        assert authority.exists()
    assert not made.exists()
    assert not lock.exists()


def test_without_xauthority_it_is_the_file_of_the_home_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("XAUTHORITY")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert authority_file() == tmp_path / ".Xauthority"


def test_a_file_that_cannot_be_written_is_named(monkeypatch):
    monkeypatch.setenv("XAUTHORITY", "/proc/nowhere/authority")
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb isn't installed")
    with pytest.raises(NoXServer, match="/proc/nowhere/authority"), xvfb(64, 48):
        pass


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs Xvfb")
def test_a_server_whose_display_was_taken_meanwhile_is_started_again(tmp_path):
    """It ends without a word then, as this one does when it's called first."""
    program = tmp_path / "server"
    program.write_text(
        f'#!/bin/sh\nif mkdir "{tmp_path}/called" 2>/dev/null; then exit 1; fi\nexec Xvfb "$@"\n'
    )
    program.chmod(0o755)
    with running_server([str(program), "-screen", "0", "64x48x24"]) as server:
        assert server.pixels().shape[:2] == (48, 64)
