"""The states that figures need, solved where they are missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ribbon_cli.errors import RibbonError
from ribbon_cli.store import resolve_state

if TYPE_CHECKING:
    from ribbon_cli.store import Run, StateRecord


class Library:
    """Runs of the configs in a folder, by the configs' names; each is solved once, when first asked for.

    `configs` is the folder of the configs, `runs` that of the runs. What a run did not reach is missing in
    it; the figures say whether they need it.
    """

    def __init__(self, configs: Path, runs: Path) -> None:
        self.configs = configs
        self.root = runs
        self._runs: dict[str, Run] = {}

    def path(self, config: str) -> Path:
        """The file of a config."""
        return self.configs / f"{config}.yaml"

    def run(self, config: str) -> Run:
        """The run of a config, solved to its end as far as it goes. Raises ConfigError, StoreError."""
        if config not in self._runs:
            from ribbon_cli.api import solve

            self._runs[config] = solve(self.path(config), runs=self.root).run
        return self._runs[config]

    def state(self, config: str, half_width: float, segments: int) -> StateRecord:
        """The equilibrium of a config's run at a width and N. Raises UsageError where there is none."""
        run = self.run(config)
        label = resolve_state(self.root, f"{run.name}@b={half_width!r},N={segments}")[1]
        assert label is not None
        return run.load(label)

    def last(self, config: str) -> StateRecord:
        """The equilibrium or saddle that a config's run stored last."""
        run = self.run(config)
        return run.load([s.label for s in run.states(all=True) if s.kind != "auxiliary"][-1])

    def stage(self, config: str, stage: str) -> StateRecord:
        """The state that a stage of a config's run stored last. Raises RibbonError where there is none."""
        run = self.run(config)
        labels = [label for label, entry in run.entries().items() if entry.state.stage == stage]
        if not labels:
            raise RibbonError(f"{run.name} has no state of the stage {stage!r}")
        return run.load(labels[-1])

    def reference(self, config: str, record: StateRecord) -> str:
        """The name of a state of a config's run."""
        return f"{self.run(config).name}:{record.label}"
