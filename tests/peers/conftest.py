"""Packages that only `make test-peers` installs are imported here: other targets leave the folder alone."""

from __future__ import annotations

import pytest


def pytest_ignore_collect(config: pytest.Config) -> bool | None:
    return None if config.option.markexpr == "peers" else True
