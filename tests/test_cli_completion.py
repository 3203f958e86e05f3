"""Completion by Tab: what is offered, in click's terms and in a real bash."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from cli_support import COMMAND, environment, ribbon, ribbon_json, run
from store_support import make_record, make_run

from ribbon_cli.cli.main import cli

BASH = shutil.which("bash")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Runs mobius (two equilibria, one intermediate state), ring-a, and two named twin."""
    root = tmp_path_factory.mktemp("completion")
    made = make_run(root)
    with made.writing():
        made.commit(make_record(1, kind="intermediate"))
        made.commit(make_record(2))
        made.commit(make_record(3, 20, half_width=0.8))
    make_run(root, 0, "ring-a")
    make_run(root, 0, "twin", "00000001")
    make_run(root, 0, "twin", "00000002")
    return root


@pytest.fixture
def folder(runs, tmp_path, monkeypatch):
    """A folder with a copy of these runs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    shutil.copytree(runs, tmp_path / "runs")
    (tmp_path / "ring.yaml").write_text("")
    return tmp_path


def offered(*words: str) -> list[str]:
    """What click offers for the last of `words`."""
    from click.shell_completion import ShellComplete

    *before, incomplete = words
    completions = ShellComplete(cli, {}, "ribbon", "_RIBBON_COMPLETE").get_completions(before, incomplete)
    return [item.value if item.type == "plain" else f"<{item.type}>" for item in completions]


RUNS = ["mobius", "ring-a", "twin-00000001", "twin-00000002"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["s"], ["solve", "sweep", "survey", "spectrum", "show", "schema"]),
        (["schema", "-o", ""], ["<file>"]),
        (["conv"], ["convergence-table"]),
        (["solve", "--fr"], ["--fresh"]),
        (["ls", "--ver"], ["--verbose"]),
        (["ls", ""], RUNS),
        (["ls", "r"], ["ring-a"]),
        (["export", ""], [f"{name}:" for name in RUNS]),
        (["export", "mob"], ["mobius:1", "mobius:2", "mobius:3"]),
        (["export", "mobius:"], ["mobius:1", "mobius:2", "mobius:3"]),
        (["export", "mobius-0123abcd:"], [f"mobius-0123abcd:{label}" for label in (1, 2, 3)]),
        (["export", "mobius@"], ["mobius@b=0.5,N=10", "mobius@b=0.8,N=20"]),
        (["export", "mobius@b=0.8"], ["mobius@b=0.8,N=20"]),
        (["export", "nothing:"], ["<file>"]),
        (["show", "mob"], ["mobius", "mobius:1", "mobius:2", "mobius:3"]),
        (["show", "./r"], ["<file>"]),
        (["convergence-table", "r"], ["ring-a", "<file>"]),
        (["convergence-table", "x", "--format", "m"], ["markdown"]),
        (["refine", "mobius:3", "--method", "s"], ["smooth", "split"]),
        (["init", "mob"], ["mobius-3pi", "mobius-pi", "mobius-pi-left"]),
        (["check", ""], ["<file>"]),
        (["ls", "--runs", ""], ["<dir>"]),
        (["--runs", "nowhere", "ls", ""], []),
        (["completion", "z"], ["zsh"]),
    ],
)
def test_offers(folder, words, expected):
    assert sorted(offered(*words)) == sorted(expected)


@pytest.mark.parametrize(
    "name", ["m;touch x;", "m$(touch x)", "m`touch x`", "m x", "m\x1b[2J", "m\nfile,", "m'", "m|x"]
)
def test_a_name_that_a_shell_would_obey_is_not_offered(folder, name):
    """Bash puts what it is offered into the line as it is."""
    made = folder / "runs" / f"{name}-0123abcd"
    shutil.copytree(folder / "runs" / "ring-a-0123abcd", made)
    assert offered("ls", "") == RUNS
    assert offered("ls", "m") == ["mobius"]


def test_runs_are_sought_where_the_line_says(folder):
    os.rename("runs", "mine")
    assert offered("ls", "r") == []
    assert offered("--runs", "mine", "ls", "r") == ["ring-a"]
    assert offered("ls", "--runs", "mine", "r") == ["ring-a"]


def test_damage_offers_nothing_and_raises_nothing(folder):
    (folder / "runs/mobius-0123abcd/log.jsonl").write_text("garbage\n")
    assert offered("export", "mobius:") == ["<file>"]
    shutil.rmtree("runs")
    (folder / "runs").write_text("")
    assert offered("ls", "") == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_scripts(shell):
    result = ribbon("completion", shell)
    assert result.exit_code == 0
    assert f"_RIBBON_COMPLETE={shell}_complete" in result.stdout
    assert ribbon_json("completion", shell)["script"].strip() == result.stdout.strip()


def test_the_shell_in_use_is_the_default():
    assert "#compdef ribbon" in ribbon("completion", env={"SHELL": "/usr/bin/zsh"}).stdout
    result = ribbon("completion", env={"SHELL": "/bin/tcsh"})
    assert (result.exit_code, result.stderr) == (2, "ribbon: which shell? name one of bash, zsh, fish\n")


def test_completion_in_a_broken_environment_is_silent(folder):
    done = run(cwd=folder, _RIBBON_COMPLETE="bash_complete", COMP_LINE="ribbon ls x", COMP_POINT="many")
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize(
    ("line", "replies"),
    [
        ("ribbon sho", ["show"]),
        ("ribbon export mobius:3", ["3"]),
        ("ribbon export mobius@b=0.8", ["0.8,N=20"]),
        ("ribbon ls --runs=runs ri", ["ring-a"]),
        pytest.param("ribbon ls ri", ["ring-a"], marks=pytest.mark.long),
        pytest.param("ribbon export mobius:", ["1", "2", "3"], marks=pytest.mark.long),
        pytest.param("ribbon export mobius@", ["@b=0.5,N=10", "@b=0.8,N=20"], marks=pytest.mark.long),
        pytest.param("ribbon export t", ["twin-00000001:", "twin-00000002:"], marks=pytest.mark.long),
        pytest.param("ribbon completion --json z", ["zsh"], marks=pytest.mark.long),
        pytest.param("ribbon convergence-table x --format=m", ["markdown"], marks=pytest.mark.long),
    ],
)
def test_a_real_bash_completes(folder, line, replies):
    """Bash breaks words behind ':' and '=' and before '@': a reply is what follows the last break."""
    program = folder / "bin/ribbon"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {" ".join(COMMAND)} "$@"\n')
    program.chmod(0o755)
    # Outside of a completion `compopt` says so on standard error, and has no effect.
    script = (
        f"{ribbon('completion', 'bash').stdout}\n"
        f"COMP_LINE='{line}' COMP_POINT={len(line)}\n"
        "_ribbon_completion ribbon\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    path = f"{program.parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [BASH, "--norc", "-c", script], env=environment(PATH=path), capture_output=True, text=True, check=True
    )
    assert sorted(done.stdout.split()) == sorted(replies), done.stderr
