"""The stages of a config run against solver and store; resume; events; entries of convergence tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .branch_tables import courses
    from .given import given_band
    from .onward import continue_state
    from .outcome import Course, Outcome, Target
    from .plan import Plan, PlannedStage, plan_of
    from .progress import Progress
    from .refine import refine_state
    from .solve import solve_config
    from .table import table_entries

__all__ = [
    "Course",
    "Outcome",
    "Plan",
    "PlannedStage",
    "Progress",
    "Target",
    "continue_state",
    "courses",
    "given_band",
    "plan_of",
    "refine_state",
    "solve_config",
    "table_entries",
]

_HOMES = {
    "Course": "outcome",
    "Outcome": "outcome",
    "Plan": "plan",
    "PlannedStage": "plan",
    "Progress": "progress",
    "Target": "outcome",
    "continue_state": "onward",
    "courses": "branch_tables",
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
