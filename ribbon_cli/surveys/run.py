"""`ribbon survey`: random starts explored, each equilibrium stored once and followed to finer meshes.

The states are those of an ordinary run. The log has a line for each start and each equilibrium followed, in
their order, whoever computed them: so the same line goes on after a kill, and the bytes of what is stored do
not depend on the number of workers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..config import Config, dump_resolved
from ..errors import UsageError
from ..model.band import Band, Discretisation
from ..model.problem import Problem
from ..model.touching_gaps import Pairs
from ..solver.resting import RestingProblem
from ..solver.status import Result
from ..store import Run
from ..store.events import SURVEY_FOLLOWED, SURVEY_START, SurveyFollowed
from ..study.acceptance import options_for
from ..study.given import given_band
from ..study.journal import run_or_read
from ..study.outcome import Outcome
from ..study.progress import Progress, silence
from ..study.records import multipliers_of, pairs_of, state_of
from ..study.walk import Ended, Stage, Walk
from . import explore, follow
from .explore import End
from .follow import Followed
from .pool import in_order
from .reading import levels_of, shape_of, standings, starts_of
from .resting import Kept
from .shapes import Kinds, Shape

LARGEST = 200
"""Most segments of a survey's mesh: climbing is dense, and the mesh is doubled three times."""


@dataclass(frozen=True)
class Request:
    """What a survey is asked for: starts, the seed of their numbers, most modes to climb, processes."""

    starts: int = 100
    seed: int = 1
    climb: int = 0
    workers: int = 1

    @property
    def climbs(self) -> tuple[int, ...]:
        """Numbers of modes that are climbed from each start, 0 for a descent."""
        return tuple(range(self.climb + 1))

    def name(self, config: Config) -> str:
        """Name of the survey's run."""
        climbed = f"-climb-{self.climb}" if self.climb else ""
        return f"{config.name}-survey-{self.seed}{climbed}"


def survey_config(
    config: Config,
    root: Path,
    request: Request,
    *,
    progress: Progress | None = None,
    argv: Sequence[str] = (),
) -> Outcome:
    """Survey the equilibria of the first place that a config names, on its coarsest mesh, or go on.

    Raises UsageError for a config without a mesh of its own, or with too fine a one, StoreError, LockedError,
    WorkerDiedError.
    """
    if config.contact.forces and request.climb:
        raise UsageError(
            "--climb: saddles of bands that rest on themselves are not looked for: leave it out, or contact "
            f"forces of {config.path}"
        )
    band = survey_band(config, root)
    named = replace(config, name=request.name(config))
    run = Run.create_or_open(root, named.name, named.hash8(), config.text, dump_resolved(named))

    def study(watcher: Progress) -> Outcome:
        return _Survey(named, band, run, request, watcher, argv).run()

    return run_or_read(run, progress or silence, study)


def survey_band(config: Config, root: Path) -> Band:
    """The band that is surveyed. Raises UsageError."""
    guess = config.guess
    band = given_band(config, root)
    if band is None:
        assert guess.segments is not None
        assert guess.half_width is not None
        rule = Discretisation(config.discretisation)
        band = Band(guess.segments, guess.half_width, config.length, config.sigma, rule, config.parts)
    if config.widths:
        band = band.with_half_width(config.widths[0])
    if band.segments > LARGEST:
        raise UsageError(
            f"{config.path}: initial_guess.segments: a survey's mesh has at most {LARGEST} segments, got "
            f"{band.segments}: what is found there is followed to finer ones"
        )
    return band


class _Survey:
    """One pass over a survey."""

    def __init__(
        self,
        config: Config,
        band: Band,
        run: Run,
        request: Request,
        progress: Progress,
        argv: Sequence[str],
    ) -> None:
        self.config, self.band, self.request = config, band, request
        folder = Path(config.path).parent
        origin = folder if folder.is_dir() else None
        total = request.starts
        self.gap = config.contact.gap if config.contact.forces else None
        self.walk = Walk(
            run, config.half_twists, config.spectrum, progress, argv, origin, total, gap=self.gap
        )
        self.journal = self.walk.journal
        self.guard = options_for(config.half_twists).guard if band.closed else None

    def run(self) -> Outcome:
        """Explore the starts that are left, then follow what was found."""
        self._explore()
        for level in levels_of(self.band.segments):
            self._follow(level)
        if self.journal.run.is_writing:
            self.journal.log("ended", exit_code=0, missed=())
        return Outcome(self.journal.run, (), tuple(self.journal.notes), self.journal.new_states)

    # --- starts ---

    def _explore(self) -> None:
        known = starts_of(self.journal.run)
        left = [k for k in range(1, self.request.starts + 1) if k not in known]
        if not left:
            return
        self.journal.clock()  # which asks for the run to be opened for writing
        kinds = self._kinds()
        band, half_twists, seed = self.band, self.config.half_twists, self.request.seed
        tasks = [explore.Task(band, half_twists, seed, k, self.request.climbs, self.gap) for k in left]
        for start, ends in zip(left, in_order(explore.explore, tasks, self.request.workers), strict=True):
            self.walk.begin(f"start {start}", band.half_width, band.segments)
            lines = [self._end(kinds, start, end) for end in ends]
            self.journal.log(SURVEY_START, start=start, ends=lines)

    def _kinds(self) -> Kinds:
        """The equilibria that the starts so far have found, in the order in which they were."""
        run, kinds = self.journal.run, Kinds(self.guard)
        for _, event in sorted(starts_of(run).items()):
            for end in event.ends:
                if end.stored is None or end.stored not in run.entries():
                    continue
                shape = shape_of(run.load(end.stored))
                known = next((kind for kind in kinds.known if kind.label == end.found), None)
                if known is None:
                    kinds.add(end.stored, shape)
                else:
                    kinds.improve(known, end.stored, shape)
        return kinds

    def _end(self, kinds: Kinds, start: int, end: End) -> dict[str, object]:
        """Store the state that a way ended in, if it is a new one, and say what it is."""
        line: dict[str, object] = {"climb": end.climb, "status": end.word, "found": None, "stored": None}
        shape = None if end.result is None else Shape.of(end.result, self.gap)
        if shape is None or end.result is None:
            return line
        kind = kinds.of(shape)
        if kind is not None and kind.shape.index <= shape.index:
            return line | {"found": kind.label}
        climbed = f", {end.climb} mode{'s' * (end.climb > 1)} climbed" if end.climb else ""
        stage = f"start {start}{climbed}"
        label = self._stored(stage, None, end.result, end.pairs, "a random start")
        if kind is None:
            kind = kinds.add(label, shape)
            self.journal.note(f"{stage}: a new equilibrium, E = {shape.energy:.9g}, index {shape.index}")
        else:
            kinds.improve(kind, label, shape)
        return line | {"found": kind.label, "stored": label}

    def _stored(
        self, stage: str, parent: int | None, result: Result, pairs: Pairs | None, method: str
    ) -> int:
        known = self.journal.finished(stage)
        if known is not None:
            return known.label
        band = result.state.band
        named = Stage(stage, band.half_width, band.segments, "equilibrium", parent)
        problem = Problem(band)
        if self.gap is not None and pairs is not None:
            problem = RestingProblem(band, pairs, self.gap)
        return self.walk.store(named, Ended(problem, replace(result, saddles=()), method)).label

    # --- finer meshes ---

    def _follow(self, level: int) -> None:
        """Follow to a mesh what was met on the ones before it."""
        run = self.journal.run
        known = standings(run, self.band.segments)
        at = levels_of(self.band.segments).index(level)
        left = {
            k: s.labels[-1] for k, s in sorted(known.items()) if s.verdict is None and len(s.labels) == at + 1
        }
        if not left:
            return
        self.journal.clock()
        kinds = self._kinds_at(level)
        tasks = [self._task(label, level) for label in left.values()]
        ends = in_order(follow.follow, tasks, self.request.workers)
        for (found, parent), end in zip(left.items(), ends, strict=True):
            self.walk.begin(f"state {parent} on a finer mesh", self.band.half_width, level)
            self._log(kinds, found, parent, level, end)

    def _task(self, label: int, level: int) -> follow.Task:
        record = self.journal.run.load(label)
        index = record.negative_eigenvalues or 0
        kept, held = None, record.contacts
        if held is not None:
            kept = Kept(multipliers_of(record), pairs_of(held), held.force, held.gap)
        return follow.Task(state_of(record), record.energy, index, level, self.config.half_twists, kept)

    def _kinds_at(self, level: int) -> Kinds:
        """The equilibria that were met on a finer mesh."""
        kinds, run = Kinds(self.guard), self.journal.run
        for event in run.events():
            if not isinstance(event, SurveyFollowed) or event.segments != level:
                continue
            if event.label is None or event.label not in run.entries():
                continue
            if all(kind.label != event.label for kind in kinds.known):
                kinds.add(event.label, shape_of(run.load(event.label)))
        return kinds

    def _log(self, kinds: Kinds, found: int, parent: int, level: int, end: Followed) -> None:
        label = None
        shape = None if end.result is None else Shape.of(end.result, self.gap)
        if end.result is not None and shape is not None:
            kind = kinds.of(shape)
            if kind is None:
                stage = f"state {parent} refined to N = {level}"
                label = self._stored(stage, parent, end.result, end.pairs, "refined")
                kinds.add(label, shape)
            else:
                label = kind.label
        facts = {"word": end.word, "label": label, "distance": end.distance, "why": end.why}
        self.journal.log(SURVEY_FOLLOWED, found=found, segments=level, **facts)
