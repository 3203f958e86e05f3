"""Where the config of a sweep's point leads, and which states are there: only these are the point's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ribbon_cli.config import Config
from ribbon_cli.facts import same_value, same_width
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS
from ribbon_cli.report.rows import LEADING
from ribbon_cli.store import Run, Summary
from ribbon_cli.study.plan import PlannedStage, stages_of
from ribbon_cli.study.run_config import resolved_config


@dataclass(frozen=True)
class Aims:
    """The equilibria that a config plans, in order, `branch` those that a branch is to meet."""

    config: Config
    walk: tuple[PlannedStage, ...]
    branch: tuple[PlannedStage, ...]

    @classmethod
    def of(cls, run: Run) -> Aims:
        """Those of a run's config. Raises StoreError, ConfigError where that cannot be read."""
        return cls.of_config(resolved_config(run))

    @classmethod
    def of_config(cls, config: Config) -> Aims:
        """Those of a config."""
        planned = _equilibria(config)
        count = len(_equilibria(replace(config, arclength=None)))
        return cls(config, planned[:count], planned[count:])

    def is_end(self, state: Summary, keys: Iterable[str]) -> bool:
        """Whether a state is where the config leads: where it last comes to the state's half-width.

        If one of the `keys` that vary is about the branch, only what the branch was to meet is.
        """
        return _is_last(state, self.branch if any(map(_of_branch, keys)) else (*self.walk, *self.branch))

    def holds(self, key: str, value: Any, state: Summary) -> bool:
        """Whether a key that varies is true of a state.

        One that says where the schedule leads is true of states at its end, and of points on the branch that
        the config follows from there. A parameter that holds from the start is true until the state has
        another value, unless the schedule itself moves it.
        """
        if is_leading(key):
            on_branch = self.config.arclength is not None and state.branch is not None
            return on_branch or _is_last(state, () if _of_branch(key) else self.walk)
        name = parameter_of(key)
        own = state.parameters.get(name)
        if own is None or not isinstance(value, int | float):
            return True
        return same_value(name, own, value, state.length) or self._moves(name, value)

    def missed(self, states: Sequence[Summary]) -> bool:
        """Whether one of the equilibria that the schedule ends in is not among these."""
        ends = {(stage.half_width, stage.segments): stage for stage in self.walk}.values()
        return not all(
            any(end.segments in (None, state.segments) and _is_at(state, end) for state in states)
            for end in ends
        )

    def _moves(self, name: str, value: Any) -> bool:
        """Whether the config itself takes a parameter away from a value."""
        branch = self.config.arclength
        if branch is not None and branch.parameter == name:
            return True
        values = (stage.parameters.get(name, value) for stage in self.walk)
        return any(not same_value(name, value, own, self.config.length) for own in values)


def _of_branch(key: str) -> bool:
    """Whether a dotted key is about the branch that a config follows."""
    return "arclength" in key.split(".")


def is_leading(key: str) -> bool:
    """Whether a dotted key says where a schedule leads."""
    return key.partition(".")[0] in LEADING


def parameter_of(key: str) -> str:
    """The parameter that a dotted key sets, empty where it sets none."""
    words = [word for word in key.split(".") if word not in ("to", "from")]
    if words[0] == "widths":
        return HALF_WIDTH
    return words[-1] if words[-1] in PARAMETERS else ""


def repeats(key: str, row: Mapping[str, Any]) -> bool:
    """Whether a key of a row says no more than the state's own parameter."""
    name, value = parameter_of(key), row.get(key)
    own = row.get(name if name == HALF_WIDTH else f"parameter_{name}")
    return value is None or (
        isinstance(value, int | float) and own is not None and same_value(name, value, own, row["length"])
    )


def _is_last(state: Summary, stages: Iterable[PlannedStage]) -> bool:
    """Whether a state is where stages last come to its half-width; False where they never do."""
    b = state.half_width
    there = [stage for stage in stages if stage.half_width is None or same_width(stage.half_width, b)]
    return bool(there) and _is_at(state, there[-1])


def _is_at(state: Summary, stage: PlannedStage) -> bool:
    """Whether a state has the parameters at which a stage aims, whatever its N; unknown ones tell nothing."""
    found = ((name, value, state.parameters.get(name)) for name, value in stage.parameters.items())
    return all(own is None or same_value(name, own, value, state.length) for name, value, own in found)


def _equilibria(config: Config) -> tuple[PlannedStage, ...]:
    return tuple(stage for stage in stages_of(config) if stage.kind == "equilibrium")
