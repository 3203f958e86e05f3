"""`ribbon rm RUN:LABEL` and `--branch`: what goes when states that commands added are removed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..errors import UsageError
from ..store import Run, Summary, typed
from ..text import ranges
from .branch_tables import courses
from .outcome import Course
from .plan import by_command


@dataclass(frozen=True)
class Request:
    """States by label, branches by number, counted from 1 as `ribbon show` does; `dependents` takes whatever
    came from them as well.
    """

    labels: tuple[int, ...] = ()
    numbers: tuple[int, ...] = ()
    dependents: bool = False


@dataclass(frozen=True)
class Removal:
    """Labels of the states to be removed, and the branches whose ends in the log count no longer."""

    request: Request
    labels: tuple[int, ...]
    branches: tuple[str, ...]


def removal_of(run: Run, request: Request) -> Removal:
    """What goes with the states and branches of a request.

    Saddles that were left on the way to a state go with it. Raises UsageError for a state or branch of the
    config, which the next solve would compute again; for one from which others came, unless these go as
    well; and for a branch that is not there.
    """
    states = {state.label: state for state in run.states(all=True)}
    branches = courses(run)
    chosen = [_branch(run, branches, number) for number in request.numbers]
    wanted = {*request.labels, *(point.label for course in chosen for point in course.points)}
    stages = {label: state.stage for label, state in states.items()}
    of_config = [stages[label] for label in sorted(wanted)] + [f"{course.name}, " for course in chosen]
    for stage in of_config:
        if not by_command(stage, stages):
            raise UsageError(
                f"{run.name}: {stage.rstrip(', ')} is the config's, and the next solve would compute it "
                "again: only what `ribbon continue` and `ribbon refine` added is removed"
            )
    free = wanted | set(_saddles_on_the_way(states, wanted))
    every = _with_dependents(states, free)
    if every != free and not request.dependents:
        rest = sorted(every - free)
        come = "comes" if len(rest) == 1 else "come"
        raise UsageError(
            f"{run.name}: {_named(rest)} {come} from what is to be removed: add --with-dependents to remove "
            f"{'it' if len(rest) == 1 else 'them'} too"
        )
    for label in sorted(every - free):
        if not by_command(stages[label], stages):
            raise UsageError(f"{run.name}: state {label}, of the config, comes from what is to be removed")
    touched = [
        course.name
        for course in branches
        if course in chosen or course.start in every or any(point.label in every for point in course.points)
    ]
    return Removal(request, tuple(sorted(every)), tuple(touched))


def remove(run: Run, removal: Removal) -> None:
    """Remove what was agreed on.

    Raises UsageError where meanwhile it would come to something else, LockedError, StoreError.
    """
    with run.writing():
        if removal_of(run, removal.request) != removal:
            raise UsageError(f"{run.name}: another process has changed it meanwhile: give the command again")
        run.remove_states(removal.labels, removal.branches)


def _branch(run: Run, branches: Sequence[Course], number: int) -> Course:
    """A branch by its number. Raises UsageError."""
    if not 1 <= number <= len(branches):
        has = f"branches 1 to {len(branches)}" if branches else "none"
        raise UsageError(
            f"{run.name} has no branch {number}: it has {has}; `ribbon show {typed(run)}` numbers them"
        )
    return branches[number - 1]


def _saddles_on_the_way(states: Mapping[int, Summary], wanted: Collection[int]) -> Iterator[int]:
    """The saddles that were left on the way to states."""
    ended = {states[label].stage for label in wanted}
    return (label for label, state in states.items() if state.kind == "saddle" and state.stage in ended)


def _with_dependents(states: Mapping[int, Summary], labels: Collection[int]) -> set[int]:
    """States with all that came from them. A saddle counts as come from by the state that ended its stage:
    computed again, a stage goes by how many of its saddles are stored.
    """
    found, size = set(labels), -1
    while size != len(found):
        size = len(found)
        ended = {states[label].stage for label in found}
        found |= {label for label, state in states.items() if state.parent in found or state.stage in ended}
    return found


def _named(labels: Sequence[int]) -> str:
    """States in words."""
    return f"state {labels[0]}" if len(labels) == 1 else f"states {ranges(labels)}"
