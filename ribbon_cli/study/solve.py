"""Runs the stages of a config: guess, widths, refinement. The same call again resumes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..config import Arclength, Config, dump_resolved
from ..errors import UsageError
from ..model.band import Band, Discretisation, State
from ..model.problem import Problem
from ..recipes.cylinder import cylinder
from ..recipes.eversion import not_everted
from ..recipes.twist import twist_stage, twist_stages
from ..solver.arclength import nearest
from ..solver.continuation import Move, to_width
from ..solver.newton import solve
from ..solver.status import Result, Status
from ..solver.tracking import PARTS
from ..store import Run, StateRecord, configs
from ..store.folder import is_run
from .auxiliary import MOST_HALVINGS, Turning
from .branch import Branches
from .constructions import construct, evert
from .contact import locate_contact
from .given import given_state, refused
from .journal import converged, run_or_read
from .nearest import what_changed
from .outcome import Course, Outcome, Target
from .plan import guess_notes, plan_of, refined_at, refinement_name, start_name, visits, width_name
from .progress import Progress, Silence
from .records import Clock, multipliers_of, saddle_result, state_of
from .steps import Steps


def solve_config(
    config: Config,
    root: Path,
    *,
    fresh: bool = False,
    progress: Progress | None = None,
    argv: Sequence[str] = (),
    references: Path | None = None,
) -> Outcome:
    """Run all stages of a config that its run does not hold yet.

    `root` is the folder of the runs; `references` is that of the runs that the config's guess may refer to,
    by default the same. `fresh` puts an existing run aside first, keeping it. Targets that are not reached
    are in the outcome, and the run's log keeps which. Raises UsageError for a given state that does not fit
    (before any run folder is made), StoreError, LockedError.
    """
    given = given_state(config, references or root) if config.guess.recipe == "state" else None
    changed = what_changed(config, root)
    run = _open(config, root)
    if fresh and (run.entries() or any(configs.differing(run.path, configs.committed(run.events())))):
        run.set_aside()
        run = _open(config, root)

    def study(watcher: Progress) -> Outcome:
        one_pass = _Study(config, run, given, watcher, argv)
        try:
            if changed:
                one_pass.journal.note(changed)
            outcome = one_pass.run()
            one_pass.journal.end(outcome)
            return outcome
        finally:
            watcher.done()

    return run_or_read(run, progress or Silence(), study)


def _open(config: Config, root: Path) -> Run:
    known = root / f"{config.name}-{config.hash8()}"
    if is_run(known):
        return Run.open(known)
    return Run.create_or_open(root, config.name, config.hash8(), config.text, dump_resolved(config))


class _Study:
    """One pass over a config's stages; `stopped` says why no further width can be reached."""

    def __init__(
        self,
        config: Config,
        run: Run,
        given: tuple[State, str] | None,
        progress: Progress,
        argv: Sequence[str],
    ) -> None:
        folder = Path(config.path).parent
        self.config = config
        self.given = given
        self.steps = Steps(
            run,
            config.half_twists,
            config.spectrum,
            progress,
            argv,
            folder if folder.is_dir() else None,
            len(plan_of(config, None if given is None else _place(given[0])).stages),
            _is_everted(config, given),
        )
        self.journal = self.steps.journal
        self.targets: list[Target] = []
        self.courses: list[Course] = []
        self.stopped: str | None = None

    def run(self) -> Outcome:
        """Run everything and report."""
        current = self._start()
        if current is not None and self.config.arclength is not None:
            self._branches(current, self.config.arclength)
        elif current is not None:
            self._widths(current)
        else:
            guess = self.config.guess
            half_width, segments = (
                (guess.half_width or math.nan, guess.segments or 0)
                if self.given is None
                else _place(self.given[0])
            )
            for b in self.config.widths or (half_width,):
                self._missed(b, (segments, *refined_at(self.config, b)))
        return Outcome(
            self.journal.run,
            tuple(self.targets),
            tuple(self.journal.notes),
            self.journal.new_states,
            tuple(self.courses),
        )

    # --- the initial guess ---

    def _start(self) -> StateRecord | None:
        """The freed guess, or None with `stopped` set."""
        for note in guess_notes(self.config):
            self.journal.note(note)
        if self.given is not None:
            state, name = self.given
            return self._free(state, None, f"from {name}", parent_ref=name)
        guess = self.config.guess
        assert guess.segments is not None
        assert guess.half_width is not None
        band = Band(
            guess.segments,
            guess.half_width,
            self.config.length,
            -1 if self.config.half_twists % 2 else 1,
            Discretisation(self.config.discretisation),
        )
        ring = cylinder(band)
        if guess.recipe == "cylinder":
            return self._free(ring, None, "discrete cylinder, (3.4)-(3.5)")
        if guess.recipe == "eversion":
            joined = evert(self.steps, ring, guess.steps or 1)
            if isinstance(joined, str):
                self._stop(joined)
                return None
            return self._free(state_of(joined), joined.label, "rejoined band freed")
        if guess.recipe == "schoenke":
            made = construct(self.steps, band, self.config.half_twists)
            if isinstance(made, str):
                self._stop(made)
                return None
            return self._free(state_of(made), made.label, "construction freed")
        return self._twisted(ring, guess.steps or 1)

    def _twisted(self, ring: State, count: int) -> StateRecord | None:
        """The band twisted step by step and freed, or None with `stopped` set."""
        half_twists = self.config.half_twists
        turning = Turning(self.steps, ring, "twist", lambda index: twist_stage(half_twists, index, count))
        last = turning.run(twist_stages(half_twists, count))
        if isinstance(last, str):
            self._stop(last)
            return None
        return self._free(state_of(last), last.label, "seam closed and freed")

    def _free(
        self, state: State, parent: int | None, method: str, parent_ref: str | None = None
    ) -> StateRecord | None:
        """The equilibrium next to a guess; saddles on the way are left."""
        stage, band = start_name(self.config), state.band
        widths = self.config.widths
        named = not widths or math.isclose(widths[0], band.half_width, rel_tol=1e-9)
        kind = "equilibrium" if named else "intermediate"
        self.steps.begin(stage, band.half_width, band.segments)
        record = self.journal.finished(stage)
        if record is not None and record.parent_ref != parent_ref:
            raise refused(
                self.config,
                f"now {parent_ref}, but this run started from {record.parent_ref}: "
                f"give the config another name, or start over with --fresh",
            )
        if record is None:
            clock = self.journal.clock()
            problem = Problem(band)
            if self.config.guess.keep_saddle:
                result = self.steps.checked(nearest(state, self.steps.options.guard))
            else:
                result = self.steps.checked(solve(problem, state.vector(), None, self.steps.options))
            if not converged(result):
                result = self._saddle_left_in_vain(problem, result)
            if not converged(result):
                self._stop(f"{stage}: {result.message}")
                return None
            events = tuple(
                f"met a saddle of index {s.index} at E = {s.energy:.12g}, left along its negative direction"
                for s in result.saddles
            )
            self.steps.tell(stage, events)
            record = self.steps.store(
                problem,
                result,
                clock,
                kind=kind,
                stage=stage,
                method=method,
                parent=parent,
                parent_ref=parent_ref,
                events=events,
            )
        if not record.certified and not self._kept(record):
            self._stop(f"{stage}: {record.message}")
        return record

    def _kept(self, record: StateRecord) -> bool:
        """Whether this is a saddle at which the config asks to begin."""
        return self.config.guess.keep_saddle and record.status == Status.SADDLE.value

    def _saddle_left_in_vain(self, problem: Problem, result: Result) -> Result:
        """The last saddle that was met, where leaving it led to no band of this kind; else the result."""
        if not result.saddles:
            return result
        saddle = self.steps.checked(saddle_result(problem, result.saddles[-1]))
        if not converged(saddle):
            return result
        detail = f"(Index {saddle.negative}; the way down from it ends in: {result.message})"
        return replace(saddle, saddles=result.saddles[:-1], steps=result.steps, detail=detail)

    # --- widths ---

    def _widths(self, current: StateRecord) -> None:
        """The schedule of widths from the freed guess, each with its refinement."""
        start = current
        for k, (b, visit) in enumerate(visits(self.config.widths or (start.half_width,))):
            ended = k > 0 and self.stopped is not None  # a later visit is none of the state that stands there
            if self.stopped is None and not math.isclose(b, current.half_width, rel_tol=1e-9):
                current = self._reach(current, b, visit)
            if ended or not math.isclose(b, current.half_width, rel_tol=1e-9):
                self._missed(b, (start.segments, *refined_at(self.config, b)))
                continue
            self.targets.append(_target(current))
            self._refine(current, b, visit)
            if current.self_contact and self.config.contact == "stop" and self.stopped is None:
                self._stop_in_contact(current.half_width)

    def _stop_in_contact(self, half_width: float) -> None:
        self._stop(f"the band touches itself from b = {half_width:.10g}: contact: stop ends the schedule")

    def _reach(self, current: StateRecord, b: float, visit: int) -> StateRecord:
        """Continue to width b, halving steps that fail; the last state reached, `stopped` if it is not b."""
        while True:
            following = self._stored_step(current, b, visit) or self._step(current, b, visit)
            if following is None:
                return current
            beside = (refined_at(self.config, end) for end in (b, current.half_width))
            found = locate_contact(self.steps, current, following, next(filter(None, beside), ()))
            current = following
            if current.self_contact and self.config.contact == "stop" and self.stopped is None:
                self._stop_in_contact(found[0].half_width if found else current.half_width)
            if current.kind == "equilibrium" or self.stopped is not None:
                return current

    def _candidates(self, current: StateRecord, b: float, visit: int) -> list[tuple[str, float]]:
        """Stage names and widths to try from here: all the way, half of it, a quarter, ..."""
        goal = width_name(b, visit)
        out = [(goal, b)]
        for j in range(1, MOST_HALVINGS + 1):
            part = current.half_width + (b - current.half_width) / 2**j
            out.append((f"{width_name(part)} on the way to {goal}", part))
        return out

    def _stored_step(self, current: StateRecord, b: float, visit: int) -> StateRecord | None:
        goal = width_name(b, visit)
        # Most steps were not halved: the names of the halves are made where there was need of them.
        candidates = [(goal, b)] if self.journal.has(goal) else self._candidates(current, b, visit)
        for stage, width in candidates:
            record = self.journal.finished(stage)
            if record is not None:
                self.steps.begin(stage, width, current.segments)
                if not record.certified:
                    self._stop(f"{stage}: {record.message}")
                return record
        return None

    def _step(self, current: StateRecord, b: float, visit: int) -> StateRecord | None:
        """Compute the longest step that works; None with `stopped` set if none does."""
        state, multipliers = state_of(current), multipliers_of(current)
        failures: list[str] = []
        whole: tuple[Move, Result, Clock] | None = None
        beyond: list[float] = []
        candidates = list(enumerate(self._candidates(current, b, visit)))
        for halvings, (stage, width) in candidates[self._first_candidate(current, b) :]:
            self.steps.begin(stage, width, current.segments)
            clock = self.journal.clock()
            # Doubts are resolved down to one length, however often the step itself was halved.
            parts = max(0, PARTS - halvings)
            move = to_width(state, multipliers, width, self.steps.options, parts)
            result = self.steps.checked(move.result)
            if result.status is Status.MINIMUM:
                kind = "equilibrium" if width == b else "intermediate"
                return self.steps.store_move(
                    move, result, clock, kind=kind, stage=stage, parent=current.label, failures=failures
                )
            whole = whole or (move, result, clock)
            beyond += [width] if result.status is Status.LEFT_BRANCH else []
            failures.append(
                f"a step from b = {current.half_width:.12g} to {width:.12g} failed, halved: {result.message}"
            )
            self.journal.note(failures[-1])
        assert whole is not None
        move, result, clock = whole
        if beyond:
            near = 0.5 * (current.half_width + beyond[-1])
            self._stop(
                f"the branch seems to turn back (fold) near b = {near:.6g}: natural continuation towards "
                f"b = {b:.12g} ends, its last state is {current.label} at b = {current.half_width:.12g}"
            )
            return None
        self._stop(f"no step from b = {current.half_width:.12g} towards {b:.12g} succeeds. {result.message}")
        if converged(result) and move.band.half_width == b:
            return self.steps.store_move(
                move, result, clock, kind="equilibrium", stage=width_name(b, visit), parent=current.label
            )
        return None

    def _first_candidate(self, current: StateRecord, b: float) -> int:
        """Where to begin halving: at twice the step that led here, if that was a halved one.

        Read off the stored states, so that a resumed run takes the same steps.
        """
        if current.kind != "intermediate" or current.parent is None or "on the way to" not in current.stage:
            return 0
        before = self.journal.run.load(current.parent)
        last, left = abs(current.half_width - before.half_width), abs(b - current.half_width)
        if last == 0.0 or left <= 2.0 * last * (1.0 + 1e-9):
            return 0
        return min(MOST_HALVINGS, math.ceil(math.log2(left / (2.0 * last)) - 1e-9))

    def _branches(self, start: StateRecord, request: Arclength) -> None:
        """The branch through the freed guess, and those that cross it if the config asks for them."""
        self.targets.append(replace(_target(start), kept=self._kept(start)))
        if self.stopped is not None:
            return
        if math.isclose(start.half_width, request.to, rel_tol=1e-9):
            raise UsageError(f"widths.arclength.to: the start has b = {start.half_width:.12g} already")
        if self.config.contact == "stop" and "contact" not in request.stop_at:
            request = replace(request, stop_at=(*request.stop_at, "contact"))
        branches = Branches(self.steps, request, start)
        self.courses = branches.courses
        branches.follow("branch")

    # --- refinement ---

    def _refine(self, record: StateRecord, b: float, visit: int) -> None:
        """Refine a width's state level by level."""
        levels = refined_at(self.config, b)
        for k, n in enumerate(levels):
            if not record.certified:
                self._missed(b, levels[k:], f"the level before it: {record.message}")
                return
            following = self.steps.refine(record, n, refinement_name(b, n, visit), "equilibrium")
            if isinstance(following, str):
                self.journal.note(following)
                self._missed(b, levels[k:], following)
                return
            record = following
            self.targets.append(_target(record))

    # --- small things ---

    def _stop(self, why: str) -> None:
        self.stopped = why
        self.journal.note(why)

    def _missed(self, half_width: float, levels: Sequence[int], why: str | None = None) -> None:
        for n in levels:
            message = f"not reached: {why or self.stopped}"
            self.targets.append(Target(half_width, n, None, False, False, message))


def _place(state: State) -> tuple[float, int]:
    """Half-width and segments."""
    return state.band.half_width, state.band.segments


def _is_everted(config: Config, given: tuple[State, str] | None) -> bool:
    """Whether the config is about an everted cylinder, by its recipe or by the state it starts from."""
    if given is None:
        return config.guess.recipe == "eversion"
    return config.half_twists == 0 and not_everted(given[0]) is None


def _target(record: StateRecord) -> Target:
    return Target(record.half_width, record.segments, record.label, True, record.certified, record.message)
