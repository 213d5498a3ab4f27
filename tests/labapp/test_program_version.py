"""Version and commit, as a checkout, an installation from a repository, and a plain one say it."""

import json
import subprocess
from types import SimpleNamespace

import pytest

import labapp as package
from labapp.common import program_version
from labapp.common.program_version import describe_version, source_commit


@pytest.fixture(autouse=True)
def asked_anew():
    source_commit.cache_clear()
    yield
    source_commit.cache_clear()


def installed_with(text):
    return lambda name: SimpleNamespace(read_text=lambda file: text)


def test_a_checkout_says_its_commit_and_whether_it_was_changed(tmp_path, monkeypatch):
    def git(*words):
        who = ["-c", "user.name=Test", "-c", "user.email=test@example.org"]
        done = subprocess.run(
            ["git", *who, *words], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    file = tmp_path / "labapp.txt"
    file.write_text("one")
    git("init")
    git("add", "labapp.txt")
    git("commit", "-m", "first")
    head = git("rev-parse", "HEAD")
    monkeypatch.setattr(program_version, "_CHECKOUT", tmp_path)
    assert describe_version() == f"{package.__version__}, commit {head[:10]}"
    file.write_text("two")
    source_commit.cache_clear()
    assert source_commit() == f"{head[:10]}+"


def test_an_installation_from_a_repository_says_its_commit(tmp_path, monkeypatch):
    noted = {
        "url": "https://example.org/labapp",
        "vcs_info": {"vcs": "git", "commit_id": "ab" * 20},
    }
    monkeypatch.setattr(program_version, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(program_version, "distribution", installed_with(json.dumps(noted)))
    assert source_commit() == "ab" * 5


@pytest.mark.parametrize("noted", [None, '{"url": "file:///somewhere", "dir_info": {}}'])
def test_a_plain_installation_has_a_version_alone(tmp_path, monkeypatch, noted):
    monkeypatch.setattr(program_version, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(program_version, "distribution", installed_with(noted))
    assert describe_version() == package.__version__


def test_the_command_line_says_it(labapp):
    assert labapp("--version")[1].strip() == f"labapp {describe_version()}"
