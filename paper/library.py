"""The states that figures need, solved where they are missing."""

from __future__ import annotations

from pathlib import Path

import ribbon_cli as ribbon
from ribbon_cli.errors import RibbonError


class Library:
    """Runs of the configs in a folder, by the configs' paths in it without suffix.

    `configs` is the folder of the configs, `runs` that of the runs; a run is solved when first asked for,
    with its progress on standard error if `progress`. What a run did not reach is missing in it; the figures
    say whether they need it.
    """

    def __init__(self, configs: Path, runs: Path, progress: bool = False) -> None:
        self.configs = configs
        self.root = runs
        self._progress = progress
        self._outcomes: dict[str, ribbon.Outcome] = {}

    def path(self, config: str) -> Path:
        """The file of a config."""
        return self.configs / f"{config}.yaml"

    def _outcome(self, config: str) -> ribbon.Outcome:
        if config not in self._outcomes:
            outcome = ribbon.solve(self.path(config), runs=self.root, progress=self._progress)
            self._outcomes[config] = outcome
        return self._outcomes[config]

    def run(self, config: str) -> ribbon.OpenRun:
        """The run of a config, solved to its end as far as it goes. Raises ConfigError, StoreError."""
        return ribbon.OpenRun.of(self._outcome(config).run)

    def failures(self, config: str) -> tuple[str, ...]:
        """What a config's run was to reach and did not, a line each."""
        return tuple(f"{self.run(config).short_name}: {line}" for line in self._outcome(config).failures)

    def state(self, config: str, half_width: float, segments: int) -> ribbon.OpenState:
        """The equilibrium of a config's run at a width and N. Raises UsageError where there is none."""
        run = self.run(config)
        return ribbon.load_state(f"{run.name}@b={half_width!r},N={segments}", self.root)

    def last(self, config: str) -> ribbon.OpenState:
        """The equilibrium or saddle that a config's run stored last."""
        run = self.run(config)
        return run.state([s.label for s in run.states(all=True) if s.kind != "auxiliary"][-1])

    def stage(self, config: str, stage: str) -> ribbon.OpenState:
        """The state that a stage of a config's run stored last. Raises RibbonError where there is none."""
        run = self.run(config)
        labels = [state.label for state in run.states(all=True) if state.stage == stage]
        if not labels:
            raise RibbonError(f"{run.name} has no state of the stage {stage!r}")
        return run.state(labels[-1])
