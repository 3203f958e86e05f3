"""`ribbon solve`, `refine` and `convergence-table` over a study that does as it is told."""

from __future__ import annotations

import math
import os
import shutil
import signal
import sys
import time
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from cli_support import ESCAPE, QUICK_MOBIUS, parse_json, ribbon, ribbon_json
from store_support import make_record, make_run

from ribbon_cli import study
from ribbon_cli.cli import main
from ribbon_cli.cli.group import Stopped
from ribbon_cli.errors import LockedError
from ribbon_cli.study import Outcome, Target
from ribbon_cli.study.progress import Stage, Step

ENERGIES = {50: 5.14, 100: 5.15, 200: 5.1525}
UNCERTIFIED = {"certified": False, "status": "saddle", "message": "Converged to a saddle."}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A config, and a run with equilibria at N = 50, 100 and 200, b = 0.5."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    (tmp_path / "mobius.yaml").write_text(QUICK_MOBIUS)
    made = make_run(tmp_path / "runs")
    with made.writing():
        for label, (n, energy) in enumerate(ENERGIES.items(), start=1):
            made.commit(make_record(label, n, energy=energy, spectra=()))
    return tmp_path


@pytest.fixture
def scripted(folder, monkeypatch):
    """Replaces both of study's solvers; the calls are recorded."""
    calls: list[tuple[tuple[Any, ...], dict[str, Any]]] = []

    def install(
        *targets: Target, act: Callable[..., Any] | None = None, failures: tuple[str, ...] = ()
    ) -> list:
        run = make_run(folder / "runs")

        class Scripted(Outcome):
            exit_code = 3 if failures else 0

        Scripted.failures = failures
        Scripted.causes = tuple(tuple(line.split(": ", 1)) for line in failures)

        def solver(*args: Any, **options: Any) -> Outcome:
            calls.append((args, options))
            if act is not None:
                act(options["progress"])
            return Scripted(run=run, targets=targets, notes=("a note",), new_states=1)

        monkeypatch.setattr(study, "solve_config", solver)
        monkeypatch.setattr(study, "refine_state", solver)
        return calls

    return install


def reached(label: int, segments: int, certified: bool = True) -> Target:
    return Target(0.5, segments, label, True, certified, "")


MISSED = Target(0.8, 50, None, False, False, "Stalled.")


def test_solve_prints_a_table_of_targets(scripted):
    calls = scripted(reached(1, 50), reached(2, 100))
    result = ribbon("solve", "mobius.yaml")
    assert result.exit_code == 0
    lines = [line.split() for line in result.stdout.splitlines()]
    assert lines[0][:6] == ["b", "N", "label", "E", "status", "Lk"]
    assert lines[1][:6] == ["0.5", "50", "1", "5.140000000", "minimum", "0.5"]
    assert lines[2][-1] == "yes"
    assert "1 new state; `ribbon ls mobius` lists the run" in result.stderr
    (config, root), options = calls[0]
    assert (config.name, str(root), options["fresh"]) == ("mobius", "runs", False)
    assert options["argv"] == ("ribbon", "solve", "mobius.yaml")
    ribbon("--runs", "other", "solve", "mobius.yaml", "--fresh")
    assert str(calls[1][0][1]) == "other"
    assert calls[1][1]["fresh"] is True


def test_targets_are_told_by_all_parameters_that_a_schedule_moves(scripted):
    places = ("b = 0.5, shear = 0.1", "b = 0.5, shear = 0.2")
    scripted(replace(reached(1, 50), place=places[0]), replace(MISSED, place=places[1]))
    lines = ribbon("solve", "mobius.yaml").stdout.splitlines()
    assert [line[:22].rstrip() for line in lines] == ["place", *places]
    assert "not reached" in lines[2]


def test_solve_prints_one_json_document(scripted):
    scripted(reached(1, 50), MISSED, failures=("b = 0.8, N = 50: stalled",))
    for more in ((), ("-q",), ("-v",)):
        result = ribbon("solve", "mobius.yaml", "--json", *more)
        assert result.exit_code == 3
        assert "ribbon: b = 0.8, N = 50: stalled\n" in result.stderr
        document = parse_json(result.stdout)
    assert document["run"] == "mobius-0123abcd"
    assert document["exit_code"] == 3
    assert [state["label"] for state in document["states"]] == [1]
    assert [target["reached"] for target in document["targets"]] == [True, False]
    assert document["failures"] == ["b = 0.8, N = 50: stalled"]


def test_quiet_leaves_errors_and_data(scripted):
    scripted(MISSED, failures=("b = 0.8, N = 50: stalled",))
    result = ribbon("solve", "mobius.yaml", "-q")
    assert result.exit_code == 3
    assert result.stderr == "ribbon: b = 0.8, N = 50: stalled\n"
    assert result.stdout.splitlines()[1].split()[:5] == ["0.8", "50", "-", "-", "not"]


def test_targets_missed_for_one_reason_share_a_line(scripted):
    why = "not reached: the branch seems to turn back (fold) near b = 0.6"
    places = ("b = 0.7, N = 50", "b = 0.7, N = 100", "b = 0.8, N = 50")
    other = "b = 0.5, N = 100: Converged to a saddle."
    scripted(MISSED, failures=(other, *(f"{place}: {why}" for place in places)))
    for command in ("solve", "convergence-table"):
        result = ribbon(command, "mobius.yaml", "-q")
        assert result.exit_code == 3
        assert result.stderr.splitlines() == [f"ribbon: {other}", f"ribbon: {'; '.join(places)}: {why}"]


def test_progress_goes_to_standard_error(scripted):
    def act(progress: Any) -> None:
        progress(Stage("b = 0.5", 1, 1, 0.5, 50))
        progress(Step(1, 5.14, 1e-12))

    scripted(reached(1, 50), act=act)
    result = ribbon("solve", "mobius.yaml")
    assert "[1/1] b = 0.5, N = 50: E = 5.140000000, residual 1.0e-12, 1 step" in result.stderr
    assert "[1/1]" not in result.stdout
    assert ESCAPE not in result.output


def test_a_locked_run_is_exit_code_5(scripted):
    def act(progress: Any) -> None:
        raise LockedError("mobius: locked by process 1 on there")

    scripted(act=act)
    result = ribbon("solve", "mobius.yaml", "-q")
    assert (result.exit_code, result.stdout) == (5, "")
    assert result.stderr == "ribbon: mobius: locked by process 1 on there\n"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("words", [["solve", "mobius.yaml"], ["refine", "mobius:1", "--to", "80"]])
def test_interruptions_say_what_is_kept(scripted, number, code, words):
    def act(progress: Any) -> None:
        raise Stopped(number)

    scripted(act=act)
    result = ribbon(*words, "-q")
    assert (result.exit_code, result.stdout) == (code, "")
    name = signal.Signals(number).name
    kept = "everything committed is kept, and the same command resumes"
    assert result.stderr == f"ribbon: interrupted by {name}: {kept}\n"


def test_a_signal_in_a_callback_that_cannot_raise_stops_a_moment_later(monkeypatch, capfd):
    """As in those of weak references, which h5py has by the thousand: Python drops what they raise."""

    class Thing:
        pass

    monkeypatch.setattr(sys, "unraisablehook", main._unraised)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGALRM)}
    signal.signal(signal.SIGTERM, main._stop)
    try:
        things = [Thing()]
        kept = weakref.ref(things[0], lambda _: signal.raise_signal(signal.SIGTERM))

        def work():
            things.clear()
            time.sleep(10)

        with pytest.raises(Stopped) as stopped:
            work()
        assert kept() is None
        assert stopped.value.number == signal.SIGTERM
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert capfd.readouterr().err == ""


def test_refine_hands_over_what_it_is_given(scripted):
    calls = scripted(reached(2, 100))
    assert ribbon("refine", "mobius:1", "--to", "100").exit_code == 0
    assert ribbon_json("refine", "mobius:1", "--levels", "2", "--method", "split")["new_states"] == 1
    kept = [{key: call[1][key] for key in ("to", "levels", "method")} for call in calls]
    assert kept == [
        {"to": 100, "levels": None, "method": "smooth"},
        {"to": None, "levels": 2, "method": "split"},
    ]
    assert str(calls[0][0][0]) == "runs"
    assert calls[0][0][1] == "mobius:1"


def test_a_config_that_is_wrong_is_not_solved(scripted):
    calls = scripted()
    with open("mobius.yaml", "a") as file:
        file.write("contakt: stop\n")
    for command in ("solve", "convergence-table"):
        result = ribbon(command, "mobius.yaml", "-q")
        assert (result.exit_code, result.stdout) == (2, "")
        assert result.stderr.startswith("mobius.yaml:7:1: contakt: unknown key")
    assert not calls


def test_convergence_table_of_a_run(folder):
    result = ribbon("convergence-table", "mob")
    assert result.exit_code == 0
    assert result.stderr == ""
    rows = ribbon_json("convergence-table", "mobius")["rows"]
    assert [row["segments"] for row in rows] == [50, 100, 200]
    assert rows[0]["delta"] == pytest.approx(0.01)
    assert rows[0]["ratio"] == pytest.approx(4.0)
    assert rows[0]["order"] == pytest.approx(2.0)
    assert rows[2]["delta"] is None
    assert (
        ribbon("convergence-table", "mob", "--format", "json").stdout
        == ribbon("--json", "convergence-table", "mob").stdout
    )


@pytest.mark.parametrize(
    ("style", "start"), [("text", "  b"), ("markdown", "| b |"), ("latex", r"\begin"), ("csv", "half_width,")]
)
def test_convergence_table_formats(folder, style, start):
    text = ribbon("convergence-table", "mob", "--format", style).stdout
    assert text.startswith(start)
    result = ribbon("convergence-table", "mob", "--format", style, "-o", "table")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "wrote table\n")
    assert (folder / "table").read_text() == text
    assert ribbon("convergence-table", "mob", "--format", style, "-o", "table", "-q").exit_code == 2
    again = ribbon("convergence-table", "mob", "--format", style, "-o", "table", "--overwrite", "-q")
    assert (again.exit_code, again.stderr) == (0, "")


def test_energies_without_certificate_are_named(folder):
    made = make_run(folder / "runs")
    with made.writing():
        made.commit(make_record(4, 400, energy=math.nan, spectra=(), **UNCERTIFIED))
    result = ribbon("convergence-table", "mobius", "-q")
    assert result.exit_code == 3
    assert result.stderr == "ribbon: mobius:4: no certificate at b = 0.5, N = 400\n"
    assert ribbon_json("convergence-table", "mobius", code=3)["rows"][3]["energy"] is None


def test_convergence_table_of_a_config_solves_first(scripted):
    calls = scripted(reached(1, 50))
    result = ribbon("convergence-table", "mobius.yaml")
    assert result.exit_code == 0
    assert len(calls) == 1
    assert result.stdout == ribbon("convergence-table", "mobius").stdout
    os.rename("mobius.yaml", "config")
    assert ribbon("convergence-table", "config").stdout == result.stdout
    assert len(calls) == 2


def test_failures_of_a_config_are_named_once(scripted, folder):
    made = make_run(folder / "runs")
    with made.writing():
        made.commit(make_record(4, 400, spectra=(), **UNCERTIFIED))
        made.commit(make_record(5, 800, spectra=(), **UNCERTIFIED))
    scripted(reached(4, 400, certified=False), failures=("b = 0.5, N = 400: Converged to a saddle.",))
    result = ribbon("convergence-table", "mobius.yaml", "-q")
    assert result.exit_code == 3
    assert result.stderr.splitlines() == [
        "ribbon: b = 0.5, N = 400: Converged to a saddle.",
        "ribbon: mobius:5: no certificate at b = 0.5, N = 800",
    ]


def test_a_config_that_comes_to_nothing_has_an_empty_table(scripted, folder):
    shutil.rmtree("runs")
    scripted(MISSED, failures=("b = 0.8, N = 50: stalled",))
    result = ribbon("convergence-table", "mobius.yaml", "-q")
    assert (result.exit_code, result.stderr) == (3, "ribbon: b = 0.8, N = 50: stalled\n")
    assert ribbon_json("convergence-table", "mobius.yaml", code=3)["rows"] == []


def test_convergence_table_without_anything_to_show(folder):
    make_run(folder / "runs", 0, "empty")
    result = ribbon("convergence-table", "empty")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "has no equilibria yet" in result.stderr
    assert "did you mean mobius?" in ribbon("convergence-table", "mobbius").stderr
    assert "is a folder" in ribbon("convergence-table", "mobius", "-o", "runs").stderr
