"""Runs the stages of a config: guess, widths, refinement. The same call again resumes.

Here is what comes next, by what is stored; the rest is computed elsewhere: the guess in guess.py, a step in
width in stepping.py. They are imported when there is something to compute, so that a finished schedule of
thousands of states is passed over without NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ..config import Arclength, Config, dump_resolved
from ..doors import Later
from ..errors import UsageError
from ..facts import same_value
from ..parts import HALF_WIDTH, PARAMETERS
from ..store import Run, Summary, configs
from ..store.folder import is_run
from .config_changes import what_changed
from .failure import Failure, failure_of
from .journal import run_or_read
from .outcome import Course, Outcome, Target
from .plan import Goal, goals, guess_notes, place_name, refined_at, stages_of, start_name, steps_of
from .progress import Progress, silence
from .walk import Walk

if TYPE_CHECKING:
    from ..model.band import State
    from . import contact, stepping, touch_down
    from .given import Given
else:
    contact, stepping = Later("ribbon_cli.study.contact"), Later("ribbon_cli.study.stepping")
    touch_down = Later("ribbon_cli.study.touch_down")

_COMPUTING = ("..store.beside", ".guess", ".stepping", ".contact", ".touch_down", ".branch")
"""Modules that compute, with all that they import. A run that lasts takes them in at once: one that is first
asked for hours later may be of another version by then, and no state would say so."""


def solve_config(
    config: Config,
    root: Path,
    *,
    fresh: bool = False,
    progress: Progress | None = None,
    argv: Sequence[str] = (),
    references: Path | None = None,
    second_process: bool = True,
) -> Outcome:
    """Run all stages of a config that its run does not hold yet.

    `root` is the folder of the runs; `references` is that of the runs that the config's guess may refer to,
    by default the same. `fresh` puts an existing run aside first, keeping it. Whoever solves many configs at
    once sets `second_process` to False: see `Run.commit_soon`. Targets that are not reached are in the
    outcome, and the run's log keeps which. Raises UsageError for a given state that does not fit (before any
    run folder is made), StoreError, LockedError.
    """
    given, remarks = None, list[str]()
    if config.guess.recipe == "state":
        from .given import given_state

        given = given_state(config, references or root, remarks.append)
    changed = what_changed(config, root)
    remarks += [changed] if changed else []
    run = _open(config, root)
    if fresh and (run.entries() or any(configs.differing(run.path, configs.committed(run.events())))):
        run.set_aside()
        run = _open(config, root)
    run.second_process = second_process

    def study(watcher: Progress) -> Outcome:
        for module in _COMPUTING if run.is_writing else ():
            import_module(module, __package__)
        one_pass = _Study(config, run, given, watcher, argv)
        for remark in remarks:
            one_pass.journal.note(remark)
        outcome = one_pass.run()
        one_pass.journal.end(outcome)
        return outcome

    return run_or_read(run, progress or silence, study)


def _open(config: Config, root: Path) -> Run:
    known = root / f"{config.name}-{config.hash8()}"
    if is_run(known):
        return Run.open(known)
    return Run.create_or_open(root, config.name, config.hash8(), config.text, dump_resolved(config))


class _Study:
    """One pass over a config's stages; `stopped` says why no further width is reached, `in_contact` that the
    config asked for the stop, `on_level` holds the last state of each level beyond the first.
    """

    def __init__(
        self,
        config: Config,
        run: Run,
        given: Given | None,
        progress: Progress,
        argv: Sequence[str],
    ) -> None:
        folder = Path(config.path).parent
        planned = stages_of(config, None if given is None else _place(given.state))
        self.config = config
        self.given = given
        self.walk = Walk(
            run,
            config.half_twists,
            config.spectrum,
            progress,
            argv,
            folder if folder.is_dir() else None,
            len(planned),
            _is_everted(config, given),
            config.contact.gap if config.contact.forces else None,
        )
        self.journal = self.walk.journal
        self.planned = frozenset(stage.name for stage in planned)
        self.moved = {HALF_WIDTH, *(name for leg in config.schedule for name in leg.to)}
        self.targets: list[Target] = []
        self.courses: list[Course] = []
        self.on_level: dict[int, Summary] = {}
        self.stopped: str | None = None
        self.in_contact = False

    def run(self) -> Outcome:
        """Run everything and report."""
        current = self._start()
        if current is not None:
            self._schedule(current)
        else:
            guess = self.config.guess
            half_width, segments = (
                (guess.half_width or math.nan, guess.segments or 0)
                if self.given is None
                else _place(self.given.state)
            )
            place = self.config.start(half_width)
            for goal in goals(self.config, place) or (Goal({HALF_WIDTH: half_width}),):
                place = {**place, **goal.to}
                self._missed(place, (segments, *self._levels(place, goal)))
        return Outcome(
            self.journal.run,
            tuple(self.targets),
            tuple(self.journal.notes),
            self.journal.new_states,
            tuple(self.courses),
        )

    def _start(self) -> Summary | None:
        """The freed guess, or None with `stopped` set."""
        for note in guess_notes(self.config):
            self.journal.note(note)
        stage, given = start_name(self.config), self.given
        record = self._stored_start(stage)
        if record is None:
            from .guess import freed_guess

            found = freed_guess(self.walk, self.config, given)
            if isinstance(found, Failure):
                self._stop(found.sentence)
                return None
            record = found
        if given is not None and record.parent_ref != given.name:
            from .given import refused

            raise refused(
                self.config,
                f"now {given.name}, but this run started from {record.parent_ref}: "
                f"give the config another name, or start over with --fresh",
            )
        if not self.walk.goes_on(record) and not self._kept(record):
            self._stop_at(stage, record, steps_of(self.config))
        return record

    def _stored_start(self, stage: str) -> Summary | None:
        """The freed guess, if it and all that led to it are stored."""
        line = self.journal.ancestry(stage)
        if any(self.journal.lacks_saddle(record.stage) for record in line):
            return None
        for record in line:
            if record.stage in self.planned:  # a halved step on the way to one counts as little as in width
                self.walk.begin(record.stage, record.half_width, record.segments)
        return line[-1] if line else None

    def _kept(self, record: Summary) -> bool:
        """Whether this is a saddle at which the config asks to begin."""
        return self.config.guess.keep_saddle and record.status == "saddle"

    # --- the schedule ---

    def _schedule(self, current: Summary) -> None:
        """The schedule from the freed guess, the ends of its legs refined, and the branch at its end."""
        start, branch = current, self.config.arclength
        place = {name: value or 0.0 for name, value in start.parameters.items()}
        planned = goals(self.config, place)
        if not planned and branch is None:
            planned = [Goal({HALF_WIDTH: start.half_width})]
        for k, goal in enumerate(planned):
            ended = k > 0 and self.stopped is not None  # a later visit is none of the state that stands there
            place = {**place, **goal.to}
            if self.stopped is None and not goal.reached(current.parameters, current.length):
                current = self._reach(current, goal)
            if ended or not goal.reached(current.parameters, current.length):
                self._missed(place, (start.segments, *self._levels(place, goal)))
                continue
            self.targets.append(self._target(current))
            if goal.ends_leg:
                self._refine(current, goal)
            if current.self_contact and self.config.contact.kind == "stop" and self.stopped is None:
                self._stop_in_contact(goal, current)
        if branch is not None:
            self._branches(current, branch, bool(planned))

    def _levels(self, place: Mapping[str, float], goal: Goal) -> tuple[int, ...]:
        """Levels beyond the first to which a goal at a place is refined."""
        return refined_at(self.config, place[HALF_WIDTH]) if goal.ends_leg else ()

    def _stop_in_contact(self, goal: Goal, current: Summary, located: float | None = None) -> None:
        self.in_contact = True
        name = next(iter(goal.to))
        value = current.parameters[name] if located is None else located
        where = f"{PARAMETERS[name].symbol} = {value:.10g}"
        self._stop(f"the band touches itself from {where}: contact: stop ends the schedule")

    def _reach(self, current: Summary, goal: Goal) -> Summary:
        """Continue to a goal, halving steps that fail; the last state reached, `stopped` if it is not
        there."""
        before: Summary | None = None
        while True:
            following = self._stored_step(current, goal) or self._step(before, current, goal)
            if following is None:
                return current
            met = self._contact_between(current, following, goal)
            before, current = current, following
            if current.self_contact and self.config.contact.kind == "stop" and self.stopped is None:
                self._stop_in_contact(goal, current, met)
            if current.kind == "equilibrium" or self.stopped is not None:
                return current

    def _stored_step(self, current: Summary, goal: Goal) -> Summary | None:
        # Most steps were not halved: the names of the halves are made where there was need of them.
        ways = [(goal.name, goal.to)] if self.journal.has(goal.name) else goal.ways(_known(current))
        for stage, target in ways:
            record = self.journal.finished(stage)
            if record is not None and not self.journal.lacks_saddle(stage):
                self.walk.begin(stage, target.get(HALF_WIDTH, current.half_width), current.segments)
                if not self.walk.goes_on(record):
                    self._stop_at(stage, record)
                return record
        return None

    def _step(self, before: Summary | None, current: Summary, goal: Goal) -> Summary | None:
        """The longest step towards a goal that works, computed; `stopped` is set where none does."""
        following, why = stepping.longest_step(self.walk, before, current, goal)
        if why is not None:
            self._stop(why.sentence)
        elif following is not None and not self.walk.goes_on(following):  # stored, and a saddle was met again
            self._stop_at(following.stage, following)
        return following

    def _contact_between(self, before: Summary, after: Summary, goal: Goal) -> float | None:
        """Where self-contact begins or ends on a step towards a goal in one parameter, where it does."""
        if self.walk.gap is not None:
            if bool(before.contacts) != bool(after.contacts):
                touch_down.locate(self.walk, before, after)
            return None
        if before.self_contact == after.self_contact or goal.one is None:
            return None
        there = {**_known(before), **goal.to}[HALF_WIDTH]
        beside = (refined_at(self.config, end) for end in (there, before.half_width))
        found = contact.locate_contact(self.walk, before, after, next(filter(None, beside), ()), goal.one)
        return found[0].value if found else None

    def _branches(self, start: Summary, request: Arclength, scheduled: bool) -> None:
        """The branch through the schedule's end, or the freed guess, and those that cross it if asked for."""
        if not scheduled:
            self.targets.append(replace(self._target(start), kept=self._kept(start)))
        if self.stopped is not None:
            return
        name, here = request.parameter, start.parameters[request.parameter] or 0.0
        section = "widths" if name == HALF_WIDTH else "schedule"
        for value in request.at:  # a given state's place is known only now
            if why := request.outside(value, here, start.length):
                raise UsageError(f"{section}.arclength.at: {why}, got {value:g}")
        if same_value(name, here, request.to, start.length):
            what = f"{PARAMETERS[name].symbol} = {here:.12g}"
            raise UsageError(f"{section}.arclength.to: the start has {what} already")
        if self.config.contact.kind == "stop" and "contact" not in request.stop_at:
            request = replace(request, stop_at=(*request.stop_at, "contact"))
        from .branch import Branches

        branches = Branches(self.walk, request, self.journal.load(start))
        self.courses = branches.courses
        branches.follow("branch")
        self.targets += branches.left

    # --- refinement ---

    def _refine(self, record: Summary, goal: Goal) -> None:
        """Refine the state at the end of a leg level by level."""
        place = _known(record)
        levels = self._levels({**place, **goal.to}, goal)
        for k, n in enumerate(levels):
            if not self.walk.goes_on(record):
                self._missed(place, levels[k:], f"the level before it: {record.message}")
                return
            following = self.walk.refine(record, n, goal.refined(n), "equilibrium")
            if isinstance(following, Failure):
                following = self._along_level(following, n, goal)
            if isinstance(following, Failure):
                self.journal.note(following.sentence)
                self._missed(place, levels[k:], following.sentence)
                return
            record = self.on_level[n] = following
            self.targets.append(self._target(record))

    def _along_level(self, why: Failure, segments: int, goal: Goal) -> Summary | Failure:
        """A state of a level from the level's last one, where a band at rest on itself was not refined."""
        start = self.on_level.get(segments)
        if self.walk.gap is None or start is None or not self.walk.goes_on(start):
            return why
        self.journal.note(why.bare)
        return stepping.all_the_way(self.walk, start, Goal(goal.to, stage=goal.refined(segments)))

    # --- small things ---

    def _stop(self, why: str) -> None:
        self.stopped = why
        self.journal.note(why)

    def _stop_at(self, stage: str, record: Summary, steps: str | None = "") -> None:
        self._stop(failure_of(record, stage, steps).sentence)

    def _missed(self, place: Mapping[str, float], levels: Sequence[int], why: str | None = None) -> None:
        for n in levels:
            message = f"not reached: {why or self.stopped}"
            beyond = self.in_contact and why is None
            words = self._words(place)
            self.targets.append(
                Target(place[HALF_WIDTH], n, None, False, False, message, beyond=beyond, place=words)
            )

    def _target(self, record: Summary) -> Target:
        where, words = (record.half_width, record.segments), self._words(_known(record))
        return Target(*where, record.label, True, record.certified, record.message, place=words)

    def _words(self, place: Mapping[str, float]) -> str:
        """A place by the parameters that the schedule moves; nothing where that is the half-width alone."""
        if self.moved == {HALF_WIDTH}:
            return ""
        return place_name({name: place[name] for name in place if name in self.moved})


def _known(state: Summary) -> dict[str, float]:
    """The parameters of a stored state."""
    return {name: value or 0.0 for name, value in state.parameters.items()}


def _place(state: State) -> tuple[float, int]:
    """Half-width and segments."""
    return state.band.half_width, state.band.segments


def _is_everted(config: Config, given: Given | None) -> bool:
    """Whether the config is about an everted cylinder, by its recipe or by the state it starts from."""
    if given is None:
        return config.guess.recipe == "eversion"
    from ..recipes.eversion import not_everted

    return config.half_twists == 0 and not_everted(given.state) is None
