"""The libraries for notebooks, which the program itself does not need."""

from __future__ import annotations

import importlib
from types import ModuleType


def extra(name: str, what: str) -> ModuleType:
    """A library of the extra `notebook`. Raises ImportError, saying how to get it, where it is missing."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        advice = f"`pip install {name}`, or `pip install -e '.[notebook]'` in ribbon's folder"
        raise ImportError(f"{what} needs {name}, which is not installed: {advice}", name=name) from None
