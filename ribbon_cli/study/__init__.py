"""The stages of a config run against solver and store; resume; events; entries of convergence tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .branch_tables import courses
    from .continuum import continuum_of, continuum_of_run, equilibrium_residuals, multiplier_curves
    from .given import given_band
    from .mode_limits import SpectralTable, run_spectra, spectral_convergence
    from .onward import continue_state
    from .outcome import Course, Outcome, Target
    from .plan import Plan, PlannedStage, plan_of
    from .progress import Progress
    from .refine import refine_state
    from .removal import Removal, removal_of, remove
    from .repeat import Rerun, rerun
    from .solve import solve_config
    from .stability import Stability, arrays_of, document_of, stability_of
    from .status import RUN_STATUSES, STATE_STATUSES, standing
    from .table import run_table, table_entries
    from .verification import Verification, verify

__all__ = [
    "RUN_STATUSES",
    "STATE_STATUSES",
    "Course",
    "Outcome",
    "Plan",
    "PlannedStage",
    "Progress",
    "Removal",
    "Rerun",
    "SpectralTable",
    "Stability",
    "Target",
    "Verification",
    "arrays_of",
    "continue_state",
    "continuum_of",
    "continuum_of_run",
    "courses",
    "document_of",
    "equilibrium_residuals",
    "given_band",
    "multiplier_curves",
    "plan_of",
    "refine_state",
    "removal_of",
    "remove",
    "rerun",
    "run_spectra",
    "run_table",
    "solve_config",
    "spectral_convergence",
    "stability_of",
    "standing",
    "table_entries",
    "verify",
]

_HOMES = {
    "RUN_STATUSES": "status",
    "STATE_STATUSES": "status",
    "Course": "outcome",
    "Outcome": "outcome",
    "Plan": "plan",
    "PlannedStage": "plan",
    "Progress": "progress",
    "Removal": "removal",
    "Rerun": "repeat",
    "SpectralTable": "mode_limits",
    "Stability": "stability",
    "Target": "outcome",
    "Verification": "verification",
    "arrays_of": "stability",
    "continue_state": "onward",
    "continuum_of": "continuum",
    "continuum_of_run": "continuum",
    "courses": "branch_tables",
    "document_of": "stability",
    "equilibrium_residuals": "continuum",
    "given_band": "given",
    "multiplier_curves": "continuum",
    "plan_of": "plan",
    "refine_state": "refine",
    "removal_of": "removal",
    "remove": "removal",
    "rerun": "repeat",
    "run_spectra": "mode_limits",
    "run_table": "table",
    "solve_config": "solve",
    "spectral_convergence": "mode_limits",
    "stability_of": "stability",
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
