"""Every test runs with floating-point errors raised; underflow to zero is harmless and allowed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

# Before numpy is loaded: on matrices this small, threads of the linear algebra only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def strict_floats() -> Iterator[None]:
    with np.errstate(all="raise", under="ignore"):
        yield


FIGURES: list[str] = []


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Keep a line on what a long test saw; shown at the end."""
    return lambda text: FIGURES.append(f"{request.node.name}: {text}")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show the figures of the long tests."""
    for line in FIGURES:
        terminalreporter.write_line(line)
