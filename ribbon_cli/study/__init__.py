"""The stages of a config run against solver and store; resume; events; entries of convergence tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .given import given_band
    from .outcome import Outcome, Target
    from .plan import Plan, PlannedStage, plan_of
    from .progress import Progress
    from .refine import refine_state
    from .solve import solve_config
    from .table import table_entries

__all__ = [
    "Outcome",
    "Plan",
    "PlannedStage",
    "Progress",
    "Target",
    "given_band",
    "plan_of",
    "refine_state",
    "solve_config",
    "table_entries",
]

_HOMES = {
    "Outcome": "outcome",
    "Plan": "plan",
    "PlannedStage": "plan",
    "Progress": "progress",
    "Target": "outcome",
    "given_band": "given",
    "plan_of": "plan",
    "refine_state": "refine",
    "solve_config": "solve",
    "table_entries": "table",
}


def __getattr__(name: str) -> Any:
    """Import on first use: `ribbon check` must not wait for SciPy."""
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
