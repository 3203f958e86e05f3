"""Progress: a line a stage, a bar on a terminal, nothing when quiet."""

from __future__ import annotations

import io

import pytest
from cli_support import ESCAPE

from ribbon_cli.api import console as module
from ribbon_cli.cli.progress import progress
from ribbon_cli.cli.settings import Settings
from ribbon_cli.digits import duration
from ribbon_cli.study.progress import Note, Stage, Step


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def play(settings: Settings) -> None:
    """Three stages, the second with a note, the last two without steps."""
    with progress(settings) as shown:
        if shown is None:
            return
        shown(Stage("twist 1/1", 1, 12, 0.1, 50))
        shown(Step(1, 1.5, 1e-3))
        shown(Step(2, 1.25, 3e-12))
        shown(Stage("freed [again]", 2, 12, 0.5, 100))
        shown(Note("a saddle was left [index 1]"))
        shown(Stage("b = 0.5, refined to N = 200", 3, 12, 0.5, 200))


@pytest.fixture
def stderr(monkeypatch):
    def put(stream: io.StringIO) -> io.StringIO:
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setattr(module, "duration", lambda seconds: "0.1 s")
        monkeypatch.setenv("TERM", "xterm-256color")
        monkeypatch.setenv("COLUMNS", "120")
        return stream

    return put


def test_lines_where_there_is_no_terminal(stderr, monkeypatch):
    stream = stderr(io.StringIO())
    monkeypatch.setenv("FORCE_COLOR", "1")
    play(Settings())
    assert stream.getvalue().splitlines() == [
        "[ 1/12] twist 1/1: b = 0.1, N = 50: E = 1.250000000, residual 3.0e-12, 2 steps, 0.1 s",
        "[ 2/12] freed [again]: b = 0.5, N = 100: no steps",
        "    a saddle was left [index 1]",
        "[ 3/12] b = 0.5, N = 200: no steps",
    ]


def test_stages_without_a_step_share_a_line(stderr):
    stream = stderr(io.StringIO())
    shown = module.Lines()
    for index in (1, 2, 3):
        shown(Stage(f"twist {index}/3", index, 5, 0.5, 50))
        shown(Step(0, 1.0, 1e-12))
    shown(Stage("b = 0.8", 4, 5, 0.8, 50))
    shown(Step(1, 1.0, 1e-12))
    shown(Note("one"))
    shown(Note("two"))
    shown(Stage("b = 0.9", 5, 5, 0.9, 50))
    shown.done()
    shown.done()
    assert stream.getvalue().splitlines() == [
        "[1-3/5] no steps",
        "[4/5] b = 0.8, N = 50: E = 1.000000000, residual 1.0e-12, 1 step, 0.1 s",
        "    one",
        "    two",
        "[5/5] b = 0.9, N = 50: no steps",
    ]


def test_stages_of_an_unknown_number_are_counted_without_it(stderr):
    stream = stderr(io.StringIO())
    shown = module.Lines()
    for index in (1, 2, 3):
        shown(Stage(f"branch from 8 up, step {index}", index, 0, 0.5, 50))
        shown(Step(index - 1, 1.0, 1e-12, 0.5, "shear = 0.12" if index == 3 else ""))
    shown.done()
    assert ": b = 0.5, shear = 0.12, N = 50: E = " in stream.getvalue().splitlines()[2]
    assert [line.split(":")[0] for line in stream.getvalue().splitlines()] == [
        "[1] branch from 8 up, step 1",
        "[2] branch from 8 up, step 2",
        "[3] branch from 8 up, step 3",
    ]


def test_verbose_lines_show_every_step(stderr):
    stream = stderr(io.StringIO())
    play(Settings(verbose=True))
    assert stream.getvalue().splitlines()[:2] == [
        "    step 1: E = 1.500000000, residual 1.0e-03",
        "    step 2: E = 1.250000000, residual 3.0e-12",
    ]


def test_quiet_is_silent(stderr):
    stream = stderr(Terminal())
    play(Settings(quiet=True))
    assert stream.getvalue() == ""


@pytest.mark.parametrize("colour", [True, False])
def test_a_terminal_gets_a_bar(stderr, monkeypatch, colour):
    stream = stderr(Terminal())
    if colour:
        monkeypatch.delenv("NO_COLOR", raising=False)
    else:
        monkeypatch.setenv("NO_COLOR", "1")
    play(Settings())
    text = stream.getvalue()
    for part in ("[ 3/12] b = 0.5, N = 200", "a saddle was left [index 1]"):
        assert part in text
    assert f"{ESCAPE}[?25l" in text
    assert text.rfind(f"{ESCAPE}[?25h") > text.rfind(f"{ESCAPE}[?25l")
    colours = [f"{ESCAPE}[3{k}" in text or f";3{k}" in text for k in range(9)]
    assert any(colours) == colour


def test_a_dumb_terminal_gets_lines(stderr, monkeypatch):
    stream = stderr(Terminal())
    monkeypatch.setenv("TERM", "dumb")
    play(Settings())
    assert ESCAPE not in stream.getvalue()
    assert stream.getvalue().startswith("[ 1/12] twist 1/1")


def test_a_verbose_terminal_keeps_a_line_for_each_stage(stderr):
    stream = stderr(Terminal())
    play(Settings(verbose=True))
    assert "step 2: E = 1.250000000" in stream.getvalue()
    assert "2 steps, 0.1 s" in stream.getvalue()
    assert "[ 3/12] b = 0.5, N = 200: no steps" in stream.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.04, "0.0 s"),
        (9.94, "9.9 s"),
        (9.96, "10 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (200, "3 min 20 s"),
        (7500, "2 h 05 min"),
    ],
)
def test_durations(seconds, text):
    assert duration(seconds) == text
