"""The command line as a whole: help, near misses, exit codes, one line for each error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from cli_support import COMMAND, QUICK_MOBIUS, QUICK_RING, QUICK_SCHOENKE, environment, ribbon, run
from store_support import make_run

from ribbon_cli import errors, sweeps
from ribbon_cli.api import names as api_names
from ribbon_cli.cli.main import cli
from ribbon_cli.cli.output import emit


@pytest.fixture
def failing(monkeypatch):
    """A command `fail` that raises what it is given."""

    def add(error: BaseException) -> None:
        def fail() -> None:
            raise error

        monkeypatch.setitem(cli.commands, "fail", click.Command("fail", callback=fail))

    return add


def test_help_lists_the_commands_in_the_order_of_use():
    result = ribbon()
    assert result.exit_code == 0
    assert result.stdout == ribbon("--help").stdout == ribbon("-h").stdout
    names = [line.split()[0] for line in result.stdout.partition("Commands:\n")[2].splitlines()]
    assert names[:6] == ["init", "check", "solve", "sweep", "survey", "refine"]
    assert "..." not in result.stdout.partition("Commands:\n")[2]


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_command_has_help_and_the_shared_options(name):
    result = ribbon(name, "--help")
    assert result.exit_code == 0
    for option in ("--runs", "--json", "--quiet", "--verbose", "--debug"):
        assert option in result.stdout


def test_version():
    result = ribbon("--version")
    assert (result.exit_code, result.stdout) == (0, "ribbon 0.1.0\n")


def test_the_entry_point_imports_nothing_heavy():
    """Nor what describes a state, which `--help` does not need."""
    code = (
        "import sys, ribbon_cli, ribbon_cli.cli.main\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'rich', 'matplotlib', 'yaml', 'qdldl', 'filelock'}\n"
        "heavy |= {f'ribbon_cli.store.{name}' for name in ('record', 'summaries', 'layout', 'events')}\n"
        "sys.exit(str(sorted(heavy & sys.modules.keys())) if heavy & sys.modules.keys() else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "config", [QUICK_RING, pytest.param(QUICK_MOBIUS, marks=pytest.mark.long), QUICK_SCHOENKE]
)
def test_a_finished_run_loads_no_numerical_libraries(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ring.yaml").write_text(config)
    assert ribbon("solve", "ring.yaml", "-q").exit_code == 0
    code = (
        "import sys\n"
        "from ribbon_cli.cli.main import cli\n"
        "try: cli.main(['solve', 'ring.yaml', '-q'])\n"
        "except SystemExit as left: assert not left.code\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'qdldl', 'matplotlib', 'ribbon_cli.solver'}\n"
        "sys.exit(str(sorted(heavy & sys.modules.keys())) if heavy & sys.modules.keys() else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize(
    "words",
    [
        ["ls"],
        pytest.param(["ls", "mobius", "--status", "minimum"], marks=pytest.mark.long),
        ["path", "mobius:1"],
    ],
)
def test_listings_do_without_numpy(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make_run(tmp_path / "runs", 1)
    code = (
        "import sys\n"
        "from ribbon_cli.cli.main import cli\n"
        "try: cli.main(sys.argv[1:])\n"
        "except SystemExit as left: assert not left.code\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'matplotlib'} & sys.modules.keys()\n"
        "sys.exit(str(sorted(heavy)) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code, *words], check=True, stdout=subprocess.DEVNULL)


def test_blas_has_one_thread_whatever_the_environment_says():
    code = "import ribbon_cli.cli.main, os; print(*(os.environ[k] for k in os.environ if '_THREADS' in k))"
    changes = {"OPENBLAS_NUM_THREADS": "8", "OMP_NUM_THREADS": "4", "MKL_NUM_THREADS": ""}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment(**changes), capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == {"1"}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["slove"], "ribbon: no such command 'slove'; did you mean solve?"),
        (["zzz"], "ribbon: no such command 'zzz'; `ribbon --help` lists the commands"),
        (["solve", "--fersh", "x"], "did you mean --fresh?"),
        (["--jsn", "ls"], "did you mean --json"),
        (["--quiet"], "ribbon: missing command; `ribbon --help` tells more"),
        (["solve"], "ribbon: missing argument 'CONFIG'; `ribbon solve --help` tells more"),
        (["solve", "a", "b"], "ribbon: got unexpected extra argument (b); `ribbon solve --help` tells more"),
        (["refine", "x:1", "--to", "many"], "must be a whole number, 8 or more, got 'many'"),
        (["refine", "x:1", "--to", "9" * 5000], "must be a whole number, 8 or more, got"),
        (["refine", "x:1"], "ribbon: give one of --to N and --levels K"),
        (["refine", "x:1", "--to", "80", "--levels", "1"], "ribbon: give one of --to N and --levels K"),
        (["refine", "x:1", "--to", "80", "--method", "smoth"], "'smoth' is not one of 'smooth', 'split'"),
        (["convergence-table", "x", "--json", "--format", "csv"], "exclude each other"),
        (["completion", "tcsh"], "'tcsh' is not one of 'bash', 'zsh', 'fish'"),
        (["export", "x:1"], "ribbon: missing option '--to': one of npz, vtkhdf, obj, stl,"),
        (["export", "x:1", "-o", "a"], "ribbon: a: its suffix names the format: one of .npz, .vtkhdf,"),
        (["export", "x:1", "-o", "a.vtk"], "ribbon: no format 'vtk' (known: npz, vtkhdf,"),
        (
            ["export", "x:1", "-o", "a.obj", "--to", "stl"],
            "a.obj: its suffix is that of the format obj",
        ),
        (["plot", "x:1"], "ribbon: missing argument 'KIND'. Choose one of shape, geometry, multipliers,"),
        (["export", "x:1", "--to"], "option '--to' requires an argument"),
        (["solve", "nosuch.yaml"], "nosuch.yaml: no such file"),
    ],
)
def test_usage_errors_are_one_line_and_exit_code_2(words, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for more in ([], ["-q"]) if len(words) > 1 and words[-1] != "--to" else ([],):
        result = ribbon(*words, *more)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert line in result.stderr
        assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UsageError("u"), 2),
        (errors.TargetError("t"), 3),
        (errors.StoreError("s"), 4),
        (errors.LockedError("l"), 5),
        (errors.RibbonError("r"), 1),
        (click.ClickException("c"), 2),
    ],
)
def test_errors_are_one_line_with_their_exit_code(failing, error, code):
    failing(error)
    result = ribbon("--quiet", "fail")
    assert (result.exit_code, result.stdout, result.stderr) == (code, "", f"ribbon: {error}\n")


def test_unforeseen_errors_are_one_line_and_exit_code_1(failing):
    failing(ZeroDivisionError("by\nnought"))
    result = ribbon("fail")
    line = "ribbon: internal error: ZeroDivisionError: by nought (run again with --debug)\n"
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", line)
    failing(AssertionError())
    assert ribbon("fail").stderr == "ribbon: internal error: AssertionError (run again with --debug)\n"


def test_debug_shows_the_traceback_before_the_line(failing):
    failing(errors.StoreError("damaged"))
    result = ribbon("--debug", "fail")
    assert result.exit_code == 4
    assert result.stderr.startswith("Traceback (most recent call last):\n")
    assert result.stderr.endswith("\nribbon: damaged\n")


def test_an_interruption_is_130(failing):
    failing(KeyboardInterrupt())
    result = ribbon("fail")
    assert result.exit_code == 130
    assert result.stderr.strip() == "ribbon: interrupted by SIGINT"


def test_shared_options_go_before_and_after_the_command(tmp_path):
    make_run(tmp_path / "mine", 1)
    expected = ribbon("ls", "--runs", tmp_path / "mine", "--json").stdout
    assert '"name": "mobius-0123abcd"' in expected
    assert ribbon("--runs", tmp_path / "mine", "--json", "ls").stdout == expected
    assert ribbon("--json", "ls", "--runs", tmp_path / "mine").stdout == expected
    # The nearer to the command wins.
    assert ribbon("--runs", "elsewhere", "ls", "--runs", tmp_path / "mine", "--json").stdout == expected
    assert ribbon("ls", "--json", env={"RIBBON_RUNS": str(tmp_path / "mine")}).stdout == expected


def list_into(output, folder):
    """`ribbon ls` with its standard output somewhere else."""
    return subprocess.run(
        [*COMMAND, "ls"],
        cwd=folder,
        stdout=output,
        stderr=subprocess.PIPE,
        env=environment(),
        text=True,
        check=False,
    )


def test_a_reader_that_leaves_is_no_failure(tmp_path):
    make_run(tmp_path / "runs", 1)
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        done = list_into(gone, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_a_failure(tmp_path):
    make_run(tmp_path / "runs", 1)
    with open("/dev/full", "w") as full:
        done = list_into(full, tmp_path)
    assert done.returncode == 1
    assert done.stderr == "ribbon: standard output cannot be written: No space left on device\n"


def test_output_survives_closed_streams_and_narrow_encodings(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    emit("nobody reads this")
    monkeypatch.undo()
    make_run(tmp_path / "runs", 1)
    done = run("show", "mobius:1", cwd=tmp_path, PYTHONIOENCODING="latin-1")
    assert done.returncode == 0
    assert "\\u03ba changes sign" in done.stdout


def test_sigterm_before_anything_is_committed(tmp_path):
    """A command that only reads promises nothing about what is kept."""
    code = (
        "import os, signal, click, ribbon_cli.cli.main as m\n"
        "m.cli.add_command(click.Command('wait', callback=lambda: os.kill(os.getpid(), signal.SIGTERM)))\n"
        "import sys; sys.argv = ['ribbon', 'wait']; m.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (128 + signal.SIGTERM, "")
    assert done.stderr == "ribbon: interrupted by SIGTERM\n"


def test_kinds_of_scripts_are_named_without_what_writes_them() -> None:
    assert sweeps.SCRIPTS == api_names.SCRIPTS
