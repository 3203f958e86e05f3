"""Batch continuation of unstretchable elastic bands, with certified equilibria and a reproducible run store.

    import ribbon_cli as ribbon
    outcome = ribbon.solve("mobius-pi.yaml", progress=True)
    run = ribbon.open("mobius-pi")
    run.table(), run.to_xarray(), run.plot("convergence")
    state = run.at(b=0.5, N=400)
    state.energy, state.u, state.spectrum(), state.plot("shape")

Everything is imported when it is first asked for, so that importing this takes no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ribbon_cli.api import (
        Followed,
        OpenRun,
        OpenState,
        OpenSweep,
        Spectrum,
        load_state,
        open_sweep,
        points,
        solve,
        survey,
        sweep,
        table,
    )
    from ribbon_cli.api import open as open
    from ribbon_cli.config import Config, load_config
    from ribbon_cli.errors import RibbonError, RibbonWarning
    from ribbon_cli.store import Run, StateRecord
    from ribbon_cli.study import Outcome

__all__ = [
    "Config",
    "Followed",
    "OpenRun",
    "OpenState",
    "OpenSweep",
    "Outcome",
    "RibbonError",
    "RibbonWarning",
    "Run",
    "Spectrum",
    "StateRecord",
    "load_config",
    "load_state",
    "open_sweep",
    "points",
    "solve",
    "survey",
    "sweep",
    "table",
]
"""What `from ribbon_cli import *` brings: not `open`, which is Python's own there."""

_HOMES = {
    "Config": "config",
    "Followed": "api",
    "OpenRun": "api",
    "OpenState": "api",
    "OpenSweep": "api",
    "Outcome": "study",
    "RibbonError": "errors",
    "RibbonWarning": "errors",
    "Run": "store",
    "Spectrum": "api",
    "StateRecord": "store",
    "load_config": "config",
    "load_state": "api",
    "open": "api",
    "open_sweep": "api",
    "points": "api",
    "solve": "api",
    "survey": "api",
    "sweep": "api",
    "table": "api",
}


def __getattr__(name: str) -> Any:
    import importlib

    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("ribbon")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "__version__"})
