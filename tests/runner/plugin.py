"""The pytest plugin: which parts of it serve in which process of a run."""

from __future__ import annotations

import os
import signal
import tempfile
from pathlib import Path

import pytest

from runner.budget import CpuBudget, is_all
from runner.costs import Meter
from runner.distribution import Distribution, Worker, words_file
from runner.heap import Heap
from runner.limits import Limits
from runner.report import Reporter

_RESTARTS = "1000"
"""So many workers may be replaced: no test that ends one keeps others from being run."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addini("grace", "Seconds after its timeout in which a test must end.", default="15")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    plugins = config.pluginmanager
    if hasattr(config, "workerinput"):
        notes = Path(config.workerinput["notes"])
        words = words_file(notes, config.workerinput["workerid"]).open("w")
        plugins.register(Worker(notes))
    else:
        words = os.fdopen(os.dup(2), "w")
        plugins.register(Reporter(config))
        if is_all(config):
            plugins.register(CpuBudget(config))
    config.add_cleanup(words.close)
    if config.getoption("dist", "no") != "no":
        _distribute(config)
    else:
        plugins.register(Limits(config, words))
        plugins.register(Meter())
        plugins.register(Heap())


def _distribute(config: pytest.Config) -> None:
    notes = tempfile.TemporaryDirectory(prefix="tests-")
    config.add_cleanup(notes.cleanup)
    config.option.maxworkerrestart = config.option.maxworkerrestart or _RESTARTS
    config.pluginmanager.register(Distribution(Path(notes.name)))
    # As with Ctrl-C, what was started is ended.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
