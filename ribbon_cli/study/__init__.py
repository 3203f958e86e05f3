"""The stages of a config run against solver and store; resume; events; entries of convergence tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .given import given_band
    from .outcome import Outcome, Target
    from .plan import Plan, PlannedStage, plan_of
    from .progress import Progress
    from .refine import refine_state
    from .repeat import Rerun, rerun
    from .solve import solve_config
    from .status import RUN_STATUSES, standing
    from .table import table_entries
    from .verification import Verification, verify

__all__ = [
    "RUN_STATUSES",
    "Outcome",
    "Plan",
    "PlannedStage",
    "Progress",
    "Rerun",
    "Target",
    "Verification",
    "given_band",
    "plan_of",
    "refine_state",
    "rerun",
    "solve_config",
    "standing",
    "table_entries",
    "verify",
]

_HOMES = {
    "RUN_STATUSES": "status",
    "Outcome": "outcome",
    "Plan": "plan",
    "PlannedStage": "plan",
    "Progress": "progress",
    "Rerun": "repeat",
    "Target": "outcome",
    "Verification": "verification",
    "given_band": "given",
    "plan_of": "plan",
    "refine_state": "refine",
    "rerun": "repeat",
    "solve_config": "solve",
    "standing": "status",
    "table_entries": "table",
    "verify": "verification",
}


def __getattr__(name: str) -> Any:
    """Import on first use: `ribbon check` must not wait for SciPy."""
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
