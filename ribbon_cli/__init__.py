"""Batch continuation of unstretchable elastic bands, with certified equilibria and a reproducible run store.

    from ribbon_cli import load_state, solve
    outcome = solve("mobius-pi.yaml")
    state = load_state("mobius-pi@b=0.5,N=400")
    state.energy, state.u, state.midline

Everything is imported when it is first asked for, so that importing this takes no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ribbon_cli.api import load_state, solve
    from ribbon_cli.config import Config, load_config
    from ribbon_cli.errors import RibbonError
    from ribbon_cli.store import Run, StateRecord
    from ribbon_cli.study import Outcome

__all__ = ["Config", "Outcome", "RibbonError", "Run", "StateRecord", "load_config", "load_state", "solve"]

_HOMES = {
    "Config": "config",
    "Outcome": "study",
    "RibbonError": "errors",
    "Run": "store",
    "StateRecord": "store",
    "load_config": "config",
    "load_state": "api",
    "solve": "api",
}


def __getattr__(name: str) -> Any:
    import importlib

    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("ribbon")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
