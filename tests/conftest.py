"""Every test runs with floating-point errors raised; underflow to zero is harmless and allowed."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator

# Before numpy is loaded: on matrices this small, threads of the linear algebra only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

fstat = os.fstat


def unsynced(descriptor: int) -> None:
    """In the place of os.fsync: only a power cut tells the two apart. It refuses what that refuses."""
    fstat(descriptor)


def pytest_configure(config: pytest.Config) -> None:
    """Sync in the long tests of faults alone: thousands of small runs are written, and thrown away.

    Heed Ctrl-C where a background job was told to ignore it: processes that tests start inherit that.
    """
    if config.option.markexpr != "faults":
        os.fsync = unsynced
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def strict_floats() -> Iterator[None]:
    with np.errstate(all="raise", under="ignore"):
        yield


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Keep a line on what a long test saw; shown at the end, from the workers of xdist too."""
    return lambda text: request.node.user_properties.append(("figure", text))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show the figures of the long tests."""
    for outcome in ("passed", "failed"):
        for report in terminalreporter.getreports(outcome):
            for name, text in report.user_properties if report.when == "call" else ():
                if name == "figure":
                    terminalreporter.write_line(f"{report.nodeid}: {text}")
