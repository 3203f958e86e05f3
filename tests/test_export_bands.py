"""Exports of every kind of band and state: pi, 3 pi, ring, everted; open, cut and saddle states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from cli_support import ribbon
from test_fold_pattern import folded, lines

from ribbon_cli import solve
from ribbon_cli.config import load_config
from ribbon_cli.export.formats import FORMATS
from ribbon_cli.export.pattern import fold_pattern
from ribbon_cli.export.solid import solid
from ribbon_cli.export.svg import pattern_svg
from ribbon_cli.store import Run, StateRecord

DATA = Path(__file__).parent / "data"
CONFIGS = {
    "pi": "topology: {half_twists: -1}\ninitial_guess: {state: pi-b0.5-N50.npz}\nwidths: [0.5, 1.5]\n",
    "three": "topology: {half_twists: 3}\ninitial_guess: {state: 3pi-b0.3-N60.npz}\n",
    "everted": "topology: {half_twists: 0}\ninitial_guess: {state: everted-b0.04-N40.npz}\n",
    "ring": "topology: {half_twists: 0}\ninitial_guess: {recipe: cylinder, segments: 40, half_width: 0.3}\n",
    "eversion": "topology: {half_twists: 0}\n"
    "initial_guess: {recipe: eversion, segments: 20, half_width: 0.15, steps: 5}\n",
}


@pytest.fixture(scope="module")
def bands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs, one of each config."""
    root = tmp_path_factory.mktemp("bands")
    for path in DATA.glob("*.npz"):
        (root / path.name).write_bytes(path.read_bytes())
    with np.errstate(all="raise", under="ignore"):
        for name, text in CONFIGS.items():
            config = root / f"{name}.yaml"
            config.write_text(f"{text}spectrum: {{modes: 0, full_up_to: 0}}\n", encoding="utf-8")
            solve(load_config(config), runs=root / "runs")
    return root / "runs"


def run_of(root: Path, name: str) -> Run:
    (path,) = root.glob(f"{name}-????????")
    return Run.open(path)


def last(root: Path, name: str) -> StateRecord:
    run = run_of(root, name)
    return run.load(run.states(all=True)[-1].label)


@pytest.mark.parametrize("name", ["pi", "three", "ring", "everted"])
def test_solids_are_watertight_at_any_thickness(name, bands):
    state = last(bands, name)
    area = 2 * state.half_width * state.length
    for share in (0.002, 0.02, 0.2):
        thickness = share * state.half_width
        body = solid(state, thickness)
        mesh = trimesh.Trimesh(body.points, body.triangles, process=False)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.euler_number == 0
        # At sharp folds the walls overlap a little, which a thin solid does not notice.
        assert mesh.volume > 0
        if share == 0.002:
            assert mesh.volume == pytest.approx(area * thickness, rel=2e-3)


@pytest.mark.parametrize(("name", "half_width"), [("pi", 1.5), ("three", 0.3), ("everted", 0.04)])
def test_patterns_fold_back(name, half_width, bands):
    state = last(bands, name)
    assert state.half_width == half_width
    size = 700.0
    data = pattern_svg(fold_pattern(state, size), "a band")
    u, g = folded(lines(data, "data-node"), lines(data, "data-end"), half_width * size / state.length, size)
    b = state.g[0] - (state.g[0] @ state.u[0]) * state.u[0]
    b /= np.linalg.norm(b)
    turn = np.stack((state.u[0], np.cross(b, state.u[0]), b))
    np.testing.assert_allclose(u @ turn, state.u, atol=1e-6)
    np.testing.assert_allclose(g @ turn, state.g, atol=1e-6)


@pytest.mark.parametrize(
    "stage",
    [
        "eversion 3/5",
        pytest.param("half turned 2/4", marks=pytest.mark.long),
        pytest.param("halves rejoined", marks=pytest.mark.long),
        "saddle",
    ],
)
@pytest.mark.parametrize("form", [*FORMATS, "npz"])
def test_every_state_is_exported_or_refused_in_a_line(form, stage, bands, tmp_path):
    run = run_of(bands, "eversion")
    states = run.states(all=True)
    (label,) = [s.label for s in states if stage in (s.stage, s.status)][-1:]
    path = tmp_path / f"band.{form}"
    result = ribbon("export", f"eversion:{label}", "--to", form, "-o", path, "--runs", bands)
    if result.exit_code == 0:
        assert path.stat().st_size > 500
        if form == "stl":
            assert trimesh.load_mesh(path).is_watertight
    else:
        assert result.exit_code == 2
        assert len(result.stderr.splitlines()) == 1
        assert "Traceback" not in result.stderr
        assert not path.exists()
    # Open strips and bands in two pieces alone are refused, and only as patterns or starts of other runs.
    assert (result.exit_code == 0) or (stage == "half turned 2/4" and form in ("svg", "pdf", "fold", "npz"))
