"""Which labapp this is: its version, and the commit where that is known."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import labapp

_CHECKOUT = Path(__file__).parents[2]

_HASH_DIGITS = 10


@cache
def source_commit() -> str:
    """Return the commit that the packages were installed or checked out from; "" if unknown.

    A "+" after the first digits of its hash says that files have been changed since.
    """
    return _checkout_commit() or _installed_commit()


def describe_version() -> str:
    """Return version and commit in one line, such as "0.2.0, commit 1a2b3c4d5e"."""
    commit = source_commit()
    return f"{labapp.__version__}, commit {commit}" if commit else labapp.__version__


def _checkout_commit() -> str:
    """Ask git for the commit; "" outside a checkout or if git fails."""
    if not (_CHECKOUT / ".git").exists():
        return ""
    words = ["describe", "--always", "--exclude=*", f"--abbrev={_HASH_DIGITS}", "--dirty=+"]
    try:
        command = ["git", "-C", str(_CHECKOUT), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def _installed_commit() -> str:
    """Read the commit from pip's notes (PEP 610); "" without a note."""
    try:
        noted = distribution("labapp").read_text("direct_url.json")
    except PackageNotFoundError:
        return ""
    source = json.loads(noted or "{}").get("vcs_info", {})
    return str(source.get("commit_id", ""))[:_HASH_DIGITS]
