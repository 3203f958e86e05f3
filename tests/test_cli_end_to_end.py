"""The whole way, with the real solver: config, solve, table, refinement, export, and the Python interface."""

from __future__ import annotations

import math
import os
import pty
import select
import shutil
import subprocess

import numpy as np
import pytest
import yaml
from cli_support import (
    COMMAND,
    ESCAPE,
    QUICK_MOBIUS,
    QUICK_RING,
    environment,
    parse_json,
    ribbon,
    ribbon_json,
    run,
)

import ribbon_cli
from ribbon_cli import load_state, solve

SHOWN = {
    "half_width", "segments", "length", "topology", "energy", "status", "kkt_residual", "constraint_residual",
    "negative_eigenvalues", "linking_number", "twist", "writhe", "self_contact", "label", "run", "kind",
    "discretisation", "content_sha256",
}  # fmt: skip
"""What other programs rely on in `show --json` and `ls RUN --json`."""

EXPORTED = {
    "u", "g", "xi", "half_width", "length", "sigma", "discretisation", "lambda_1", "lambda_2", "lambda_3",
    "lambda_4", "lambda_5", "gamma", "energy",
}  # fmt: skip


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A folder with a solved ring, and what `ribbon solve --json` printed."""
    folder = tmp_path_factory.mktemp("ring")
    (folder / "ring.yaml").write_text(QUICK_RING)
    done = run("solve", "ring.yaml", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, parse_json(done.stdout), done.stderr


@pytest.fixture
def in_ring(ring, monkeypatch):
    monkeypatch.chdir(ring[0])
    monkeypatch.delenv("RIBBON_RUNS", raising=False)


def test_solve_reaches_every_target(ring):
    _, document, messages = ring
    places = [(target["half_width"], target["segments"]) for target in document["targets"]]
    assert sorted(places) == [(0.1, 12), (0.1, 24), (0.5, 12), (0.5, 24)]
    assert all(target["reached"] and target["certified"] for target in document["targets"])
    assert document["failures"] == []
    assert ESCAPE not in messages
    assert "[3/4] b = 0.5, N = 12: E = " in messages


def test_solving_again_changes_nothing(in_ring):
    document = ribbon_json("solve", "ring.yaml")
    assert document["new_states"] == 0
    assert len(document["targets"]) == 4
    (listed,) = ribbon_json("ls")
    assert listed["complete"] is True


def test_states_are_listed_shown_and_exported(in_ring, tmp_path):
    states = ribbon_json("ls", "ring")
    assert all(state.keys() >= SHOWN for state in states)
    state = ribbon_json("show", "ring@b=0.5,N=24")
    assert state.keys() >= SHOWN
    assert state["status"] == "minimum"
    assert state["linking_number"] == pytest.approx(0.0, abs=1e-9)
    # Of a regular polygon with rulings along the axis: N facets turn by 2 pi/N each, Q_h known exactly.
    assert state["energy"] == pytest.approx(math.pi * 0.5, rel=0.02)
    assert state["provenance"]["argv"].startswith("ribbon solve ring.yaml")
    assert state["provenance"]["blas_threads"] == "OPENBLAS_NUM_THREADS=1"
    path = tmp_path / "ring.npz"
    assert ribbon("export", "ring@b=0.5,N=24", "--to", "npz", "-o", path).exit_code == 0
    with np.load(path) as data:
        assert set(data.files) >= EXPORTED
        assert data["u"].shape == data["g"].shape == (24, 3)


def test_the_table_of_a_ring(in_ring):
    document = ribbon_json("convergence-table", "ring.yaml")
    assert [(row["half_width"], row["segments"]) for row in document["rows"]] == [
        (0.1, 12),
        (0.1, 24),
        (0.5, 12),
        (0.5, 24),
    ]
    assert document["rows"][0]["delta"] > 0


@pytest.mark.long
def test_a_terminal_sees_a_bar_and_colours_only_if_wanted(tmp_path):
    (tmp_path / "ring.yaml").write_text(QUICK_RING)
    for changes in ({}, {"NO_COLOR": "1"}):
        text, code = on_terminal(tmp_path, "solve", "ring.yaml", "--fresh", **changes)
        assert code == 0
        assert "b = 0.5, N = 24" in text
        assert f"{ESCAPE}[?25h" in text
        assert any(f"{ESCAPE}[{style}3{k}m" in text for k in range(9) for style in ("", "1;")) != bool(
            changes
        )


def on_terminal(folder: os.PathLike[str], *words: str, **changes: str) -> tuple[str, int]:
    """Run `ribbon` with standard error on a terminal; what it shows there, and the exit code."""
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *words],
        cwd=folder,
        env=environment(TERM="xterm-256color", **changes),
        stdout=subprocess.DEVNULL,
        stderr=end,
    )
    os.close(end)
    shown = b""
    with process:
        while select.select([terminal], [], [], 60)[0]:
            try:
                data = os.read(terminal, 65536)
            except OSError:  # how Linux says that the other end is closed
                break
            if not data:
                break
            shown += data
        os.close(terminal)
    return shown.decode(), process.returncode


@pytest.fixture(scope="module")
def mobius(tmp_path_factory):
    """A folder with a small Moebius band."""
    folder = tmp_path_factory.mktemp("mobius")
    (folder / "mobius.yaml").write_text(QUICK_MOBIUS)
    done = run("solve", "mobius.yaml", "-q", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_a_mobius_band(mobius, monkeypatch):
    monkeypatch.chdir(mobius)
    state = ribbon_json("show", "mobius@b=0.1,N=48")
    assert state["linking_number"] == pytest.approx(0.5, abs=1e-6)
    assert state["topology"] == {"half_twists": 1, "sigma": -1}
    assert state["negative_eigenvalues"] == 0
    assert max(state["kkt_residual"], state["constraint_residual"]) < 1e-9
    kinds = {item["kind"] for item in ribbon_json("ls", "mobius", "--all")}
    assert kinds >= {"equilibrium", "auxiliary"}
    assert {item["kind"] for item in ribbon_json("ls", "mobius")} == {"equilibrium"}
    table = ribbon("convergence-table", "mobius")
    assert table.exit_code == 0
    assert "Delta_N" in table.stdout


@pytest.mark.parametrize(
    ("options", "segments"), [(["--to", "36"], [36]), (["--levels", "2", "--method", "split"], [48, 96])]
)
def test_refinement_joins_the_run(mobius, monkeypatch, options, segments):
    monkeypatch.chdir(mobius)
    before = len(ribbon_json("ls", "mobius", "--all"))
    document = ribbon_json("refine", "mobius@b=0.1,N=24", *options)
    assert [target["segments"] for target in document["targets"]] == segments
    assert all(target["certified"] for target in document["targets"])
    after = ribbon_json("ls", "mobius", "--all")
    assert len(after) == before + document["new_states"]
    assert after[-1]["segments"] == segments[-1]


AGAIN = """\
name: again
topology: {half_twists: 0}
initial_guess: {state: ring@b=0.1}
"""


@pytest.fixture(scope="module")
def refined(ring, tmp_path_factory):
    """A solved ring, N = 12 and 24, to which N = 16 was added last at b = 0.1."""
    folder = tmp_path_factory.mktemp("refined")
    shutil.copytree(ring[0], folder, dirs_exist_ok=True)
    (folder / "again.yaml").write_text(AGAIN)
    done = run("refine", "ring@b=0.1,N=12", "--to", "16", "-q", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ["show", "ring@b=0.1"],
        pytest.param(["path", "ring@b=0.1"], marks=pytest.mark.long),
        pytest.param(["verify", "ring@b=0.1"], marks=pytest.mark.long),
        pytest.param(["verify", "ring@b=0.1", "--continuum"], marks=pytest.mark.long),
        ["spectrum", "ring@b=0.1"],
        pytest.param(["compare", "ring@b=0.1", "ring@b=0.1,N=24"], marks=pytest.mark.long),
        pytest.param(
            ["export", "ring@b=0.1", "--to", "npz", "-o", "x.npz", "--overwrite"], marks=pytest.mark.long
        ),
        pytest.param(
            ["plot", "ring@b=0.1", "spectrum", "-o", "x.svg", "--overwrite"], marks=pytest.mark.long
        ),
        pytest.param(
            ["plot", "ring:1", "spectrum", "--with", "ring@b=0.1", "-o", "x.svg", "--overwrite"],
            marks=pytest.mark.long,
        ),
        pytest.param(["refine", "ring@b=0.1", "--to", "24"], marks=pytest.mark.long),
        ["continue", "ring@b=0.1", "--to", "0.11"],
        ["check", "again.yaml"],
        pytest.param(["solve", "again.yaml"], marks=pytest.mark.long),
    ],
    ids=" ".join,
)
def test_every_command_takes_the_finest_state_and_says_so(refined, monkeypatch, words):
    monkeypatch.chdir(refined)
    monkeypatch.delenv("RIBBON_RUNS", raising=False)
    label = ribbon_json("show", "ring@b=0.1,N=24")["label"]
    said = f"ring@b=0.1: state {label} is taken (b = 0.1, N = 24), the finest certified one of 3 that fit\n"
    for quiet in ([], ["-q"]):
        result = ribbon(*words, *quiet)
        assert result.exit_code == 0, result.output
        assert result.stderr.count(said) == (not quiet)
        assert "is taken" not in result.stdout
    again = ribbon_json(*words)
    if words[0] == "refine":
        assert (again["new_states"], [target["label"] for target in again["targets"]]) == (0, [label])
    if words[0] in ("refine", "continue", "solve"):
        assert said.strip() in again["notes"]


def test_the_python_interface(tmp_path, monkeypatch):
    """The same from Python: NumPy's numbers and tuples in the mapping are as good as Python's."""
    config = yaml.safe_load(QUICK_RING) | {"widths": np.linspace(0.1, 0.2, 2), "refinement": (12,)}
    outcome = solve(config, runs=tmp_path / "runs")
    assert outcome.exit_code == 0
    state = load_state("ring@b=0.2", runs=tmp_path / "runs")
    assert state.u.shape == (12, 3)
    assert load_state(outcome.run.state_path(state.label)).energy == state.energy
    (tmp_path / "ring.yaml").write_text(yaml.safe_dump(yaml.safe_load(QUICK_RING)))
    monkeypatch.setenv("RIBBON_RUNS", str(tmp_path / "runs"))
    again = solve(ribbon_cli.load_config(tmp_path / "ring.yaml"))
    assert again.run.path.parent == tmp_path / "runs"
    assert solve(str(tmp_path / "ring.yaml")).new_states == 0


def test_the_python_interface_names_what_there_is():
    assert set(ribbon_cli.__all__) <= set(dir(ribbon_cli))
    assert all(getattr(ribbon_cli, name) is not None for name in ribbon_cli.__all__)
    assert ribbon_cli.__version__ == "0.1.0"
    with pytest.raises(AttributeError, match="no attribute 'solv'"):
        _ = ribbon_cli.solv
    with pytest.raises(ribbon_cli.RibbonError, match=r"config:1:\d+: widht: unknown key"):
        solve({"widht": 1})


@pytest.mark.parametrize("wrong", [5, None, b"ring.yaml", ["ring.yaml"]])
def test_arguments_of_other_types_are_named(wrong, tmp_path):
    for call, name in (
        (lambda: solve(wrong, runs=tmp_path), "config"),
        (lambda: load_state(wrong, runs=tmp_path), "ref"),
        (lambda: load_state("ring:1", runs=wrong or 5), "runs"),
    ):
        with pytest.raises(TypeError, match=rf"^{name} must be .*, got \w+$"):
            call()
    assert not any(tmp_path.iterdir())
