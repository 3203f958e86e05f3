"""`ribbon rm RUN:LABEL` and `--branch`: what commands added goes, whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest
from cli_support import ribbon, ribbon_json
from fault_support import child, contents, wait

from ribbon_cli.config import Arclength, parse_config
from ribbon_cli.errors import StoreError, UsageError
from ribbon_cli.store import Run
from ribbon_cli.store.folder import state_files
from ribbon_cli.store.verification import check_folder
from ribbon_cli.study import Request, continue_state, courses, refine_state, removal_of, solve_config
from ribbon_cli.text import ranges
from ribbon_cli.verify import verify

CONFIG = """\
name: ring
topology: {half_twists: 0}
initial_guess: {recipe: cylinder, segments: 8, half_width: 0.1}
widths: [0.1, 0.2]
refinement: [8, 16]
spectrum: {modes: 2, full_up_to: 0}
"""
ASKED = Arclength(0.14, at=(0.12,), max_step=0.05)
CALLS = ("open", "write", "fsync", "unlink", "close", "ftruncate", "pread", "fstat")


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """States 1 to 4 of the config; 5 and 6 refined from 1; a branch from 1, and one from its first point."""
    root = tmp_path_factory.mktemp("made") / "runs"
    run = solve_config(parse_config(CONFIG, "ring.yaml"), root).run
    assert refine_state(root, f"{run.name}:1", to=20).targets[0].label == 5
    assert refine_state(root, f"{run.name}:5", to=24).targets[0].label == 6
    continue_state(root, f"{run.name}:1", ASKED)
    continue_state(root, f"{run.name}:7", Arclength(0.105))
    return run.path


@pytest.fixture
def run(made, tmp_path, monkeypatch) -> Run:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(made, tmp_path / "runs" / made.name)
    return Run.open(Path("runs") / made.name)


def points(run: Run, k: int) -> tuple[int, ...]:
    """Labels of the points of the k-th branch."""
    return tuple(point.label for point in courses(run)[k].points)


def whole(run: Run) -> set[int]:
    """Labels of the states that a reader finds, each file the one that was committed."""
    fresh = Run.open(run.path)
    assert fresh.damage(fresh.entries()) == {}
    return set(fresh.entries())


def tidy(run: Run) -> None:
    """Files and log agree, and nothing is left over."""
    assert set(state_files(run.path)) == whole(run)
    assert check_folder(Run.open(run.path)) == []


def in_order(run: Run) -> None:
    """The same, and all that is said of the run is so."""
    tidy(run)
    assert verify(run.path.parent, run.name).findings == ()
    assert ribbon("ls", "ring", "--all").exit_code == 0
    assert ribbon("show", "ring").exit_code == 0


def removal(run: Run, *words: object) -> int:
    return ribbon("rm", *words, "--yes", "-q").exit_code


def test_a_state_that_was_refined_goes_and_can_be_made_again(run):
    before, path = contents(run), run.state_path(6)
    energy = run.load(6).energy
    assert removal(run, "ring:6") == 0
    assert not path.exists()
    assert contents(Run.open(run.path)) == {label: sha for label, sha in before.items() if label != 6}
    in_order(run)
    gone = ribbon("show", "ring:6")
    assert (gone.exit_code, "has no state 6" in gone.stderr) == (2, True)
    assert "states-removed 6" in ribbon("show", "ring").stdout
    again = refine_state(Path("runs"), "ring:5", to=24)
    assert (again.new_states, again.targets[0].label) == (1, max(before) + 1)
    assert run.load(max(before) + 1).energy == energy
    in_order(run)


def test_a_branch_goes_with_its_end_and_comes_back_the_same(run):
    first, second = courses(run)
    assert removal(run, "ring", "--branch", 2) == 0
    assert courses(Run.open(run.path)) == (first,)
    in_order(run)
    assert "1. branch from 1" in ribbon("show", "ring").stdout
    again = continue_state(Path("runs"), "ring:7", Arclength(0.105)).branches[0]
    assert (again.name, again.reason, again.half_width) == (second.name, second.reason, second.half_width)
    assert [p.energy for p in again.points] == [p.energy for p in second.points]
    assert courses(Run.open(run.path)) == (first, again)
    in_order(run)


def test_the_rest_of_a_branch_is_unfinished_and_followed_again(run):
    """Steps, and widths that lie within a step, whose end is stored all the same."""
    first = courses(run)[0]
    labels = points(run, 0)
    assert len(labels) > 3
    assert removal(run, *(f"ring:{label}" for label in labels[-2:])) == 0
    left = courses(Run.open(run.path))[0]
    assert (left.reason, len(left.points)) == ("unfinished", len(labels) - 2)
    again = continue_state(Path("runs"), "ring:1", ASKED)
    assert again.new_states == 2
    assert [p.energy for p in again.branches[0].points] == [p.energy for p in first.points]
    assert (again.branches[0].reason, again.branches[0].half_width) == (first.reason, first.half_width)
    in_order(run)
    width = next(point.label for point in again.branches[0].points if point.type == "width")
    assert removal(run, f"ring:{width}") == 0
    assert continue_state(Path("runs"), "ring:1", ASKED).new_states == 1
    in_order(run)


def test_what_came_from_a_state_is_named_and_goes_if_asked(run):
    result = ribbon("rm", "ring:5", "--yes")
    assert result.exit_code == 2
    assert "state 6 comes from what is to be removed: add --with-dependents to remove it too" in result.stderr
    assert removal(run, "ring:5", "ring:6") == 0
    first, second = points(run, 0), points(run, 1)
    names = [course.name for course in courses(run)]
    assert removal(run, "ring", "--branch", 1) == 2
    document = ribbon_json("rm", "ring", "--branch", 1, "--with-dependents", "--yes")
    assert document["removed"] == sorted({*first, *second})
    assert document["branches"] == names
    assert (courses(Run.open(run.path)), sorted(Run.open(run.path).entries())) == ((), [1, 2, 3, 4])
    in_order(run)
    assert solve_config(parse_config(CONFIG, "ring.yaml"), Path("runs")).new_states == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ring:2"], "b = 0.1, refined to N = 16 is the config's, and the next solve would compute it again"),
        (["ring:5", "ring:1"], "is the config's"),
        (["ring@b=0.1"], "is named by its label, as in RUN:12"),
        (["ring:5", "ring"], "is named by its label, as in RUN:12"),
        (["ring:99"], "has no state 99"),
        (["ring:5", "--branch", "1"], "--branch goes with a run"),
        (["ring", "--branch", "3"], "has no branch 3: it has branches 1 to 2"),
        (["ring", "--with-dependents"], "--with-dependents goes with states, or with --branch"),
        (["ring", "ring"], "takes one run at a time"),
    ],
)
def test_what_is_not_removed_is_explained(run, words, message):
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    result = ribbon("rm", *words, "--yes")
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert {path: path.read_bytes() for path in before} == before


def test_it_asks_and_waits_for_no_other_writer(run):
    before = contents(run)
    for answer in ("n\n", ""):
        result = ribbon("rm", "ring:5", "ring:6", input=answer)
        assert result.exit_code == 2
        assert f"remove 2 states (5-6) of {run.path}?" in result.stderr
    with run.writing():
        assert removal(run, "ring:6") == 5
    assert contents(Run.open(run.path)) == before
    assert ribbon("rm", "ring:5", "ring:6", input="y\n").exit_code == 0
    in_order(run)


def test_what_changed_while_it_asked_is_not_removed(run):
    from dataclasses import replace

    from ribbon_cli.study import remove

    agreed = removal_of(run, Request(labels=(6,)))
    refine_state(Path("runs"), "ring:6", to=28)
    with pytest.raises(UsageError, match="comes from what is to be removed"):
        remove(run, agreed)
    with pytest.raises(UsageError, match="another process has changed it meanwhile"):
        remove(run, replace(agreed, request=Request(labels=(6,), dependents=True)))
    assert 6 in run.entries()


def test_saddles_go_with_the_state_that_they_were_left_for(run):
    from dataclasses import replace

    five = run.load(5)
    with run.writing():
        label = run.next_label
        for k, kind in enumerate(("saddle", "equilibrium")):
            changes = {"label": label + k, "kind": kind, "stage": "state 1 refined to N = 20, facets split"}
            run.commit(replace(five, parent=1, **changes))
    result = ribbon("rm", f"ring:{label}", "--yes")
    assert f"state {label + 1} comes from what is to be removed" in result.stderr
    assert ribbon_json("rm", f"ring:{label + 1}", "--yes")["removed"] == [label, label + 1]
    in_order(run)


def test_a_run_without_what_was_removed_is_packed_repaired_and_rerun(run):
    assert removal(run, "ring", "--branch", 2) == 0
    assert removal(run, "ring:6") == 0
    kept = contents(Run.open(run.path))
    assert ribbon("pack", "ring", "-o", "ring.pack.h5").exit_code == 0
    assert ribbon("unpack", "ring.pack.h5", "--runs", "other").exit_code == 0
    assert contents(Run.open(Path("other") / run.name)) == kept
    assert ribbon_json("repair", "ring")["done"] == []
    run.log_path.write_bytes(run.log_path.read_bytes().replace(b"\n", b"\nnonsense\n", 1))
    assert ribbon("repair", "ring").exit_code == 0
    assert contents(Run.open(run.path)) == kept
    assert ribbon("rerun", "ring", "-q").exit_code == 0
    run.log_path.unlink()
    assert ribbon("repair", "ring").exit_code == 0
    assert contents(Run.open(run.path)) == kept
    in_order(run)


class _Calls:
    """Counts the system calls of a removal and, at the n-th, ends the process or fails."""

    def __init__(self, n: int, code: int | None) -> None:
        self.n, self.code, self.names = n, code, []

    def put_in(self, patch: pytest.MonkeyPatch) -> None:
        for name in CALLS:
            patch.setattr(os, name, self._wrapped(name, getattr(os, name)))

    def _wrapped(self, name, call):
        def wrapped(*args, **kwargs):
            self.names.append(name)
            if len(self.names) == self.n:
                if self.code is None:
                    os._exit(77)
                if name == "close":
                    call(*args)
                raise OSError(self.code, os.strerror(self.code))
            return call(*args, **kwargs)

        return wrapped


def _removal_with(run: Run, calls: _Calls) -> None:
    with run.writing(), pytest.MonkeyPatch.context() as patch:
        calls.put_in(patch)
        run.remove_states([5, 6], ["branch from 7 down"])


@pytest.fixture
def copies(made, tmp_path, monkeypatch):
    """A fresh copy of the run each time it is called."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)

    def copy() -> Run:
        shutil.rmtree("runs", ignore_errors=True)
        shutil.copytree(made, Path("runs") / made.name)
        return Run.open(Path("runs") / made.name)

    return copy


def _all_or_none(run: Run, before: set[int]) -> bool:
    """Whether two states are gone, who are there together or not at all; readers see it without a writer."""
    gone = before - whole(run)
    assert gone in (set(), {5, 6})
    assert len(courses(Run.open(run.path))) == 2
    assert courses(Run.open(run.path))[1].reason == ("unfinished" if gone else "range")
    assert all(finding.note for finding in check_folder(Run.open(run.path)))
    return bool(gone)


def test_a_kill_at_any_call_leaves_all_or_nothing(copies):
    outcomes, n, code = [], 0, 77
    while code == 77:
        n += 1
        run = copies()
        before = whole(run)
        code = wait(child(lambda run=run, n=n: _removal_with(run, _Calls(n, None))))
        outcomes.append(_all_or_none(run, before))
        has_files = {5, 6} <= set(state_files(run.path))
        assert outcomes[-1] or has_files
        if n % 3 == 0:  # the log is lost as well: what is left of the files is what counts
            run.log_path.unlink()
            run.repair()
        else:
            Run.open(run.path).sweep()
        tidy(run)
    in_order(run)
    assert code == 0
    assert outcomes == sorted(outcomes)
    assert 4 < outcomes.index(True) < len(outcomes) - 3


def test_a_call_that_fails_leaves_all_or_nothing(copies):
    n, calls = 0, _Calls(0, None)
    outcomes = []
    while len(calls.names) >= n:
        n += 1
        run, calls = copies(), _Calls(n, (errno.EIO, errno.ENOSPC, errno.EROFS)[n % 3])
        before = whole(run)
        failed = ""
        try:
            _removal_with(run, calls)
        except StoreError as error:
            failed = str(error)
            assert "cannot be written: " in failed
        outcomes.append(_all_or_none(run, before))
        assert outcomes[-1] != bool(failed), (n, calls.names, failed)
        if set(state_files(run.path)) & {5, 6} and outcomes[-1]:
            assert "the next writer deletes what is left" in run.remarks[-1]
        Run.open(run.path).sweep()
        tidy(run)
    assert len(set(outcomes)) == 2


def test_another_file_under_the_name_of_a_removed_state_is_kept(run):
    data = run.state_path(5).read_bytes()
    assert removal(run, "ring:5", "ring:6") == 0
    for bytes_, note in ((data, "deleted 0005.h5"), (b"mine", "renamed 0005.h5 to 0005.h5.damaged-1")):
        run.state_path(5).write_bytes(bytes_)
        found = verify(Path("runs"), "ring")
        assert not found.problems
        assert any("its state was removed" in finding.what for finding in found.findings)
        assert ribbon_json("repair", "ring")["done"] == []
        assert any(note in said for said in Run.open(run.path).sweep())
        assert not run.state_path(5).exists()
    assert run.state_path(5).with_name("0005.h5.damaged-1").read_bytes() == b"mine"


def test_ranges_of_labels():
    assert ranges([]) == ""
    assert ranges([3, 5, 6, 7, 9, 10]) == "3, 5-7, 9-10"
