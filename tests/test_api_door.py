"""The Python door: runs and states in hand, the same as the command line has them."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas
import pytest
import xarray
from cli_support import ESCAPE, QUICK_BRANCH, QUICK_RING, ribbon, ribbon_json
from picture_support import run_named, solved  # noqa: F401
from store_support import make_record, make_run

import ribbon_cli
from ribbon_cli.api import Note, OpenRun, OpenState, Stage, Step
from ribbon_cli.config import parse_config
from ribbon_cli.errors import LockedError, RibbonWarning, StoreError, TargetError, UsageError
from ribbon_cli.export.words import MEETS_ITSELF
from ribbon_cli.store import StateRecord, content_sha256, decode
from ribbon_cli.study import Outcome
from ribbon_cli.study.outcome import Target


@pytest.fixture
def own(solved: Path, tmp_path: Path) -> OpenRun:  # noqa: F811
    """A copy of the solved Möbius run, to add to."""
    source = run_named(solved, "mobius").path
    return ribbon_cli.open(Path(shutil.copytree(source, tmp_path / "runs" / source.name)))


@pytest.fixture
def stored(tmp_path: Path) -> OpenRun:
    """A run of random records: equilibria at three of four places of a grid, one of them no minimum."""
    made = make_run(tmp_path / "runs")
    with made.writing():
        made.commit(make_record(1, kind="intermediate", stage="twist 1/2", half_width=1.0))
        made.commit(make_record(2, half_width=1.0, energy=1.0))
        made.commit(make_record(3, 20, half_width=1.0, energy=1.5, self_contact=True))
        made.commit(
            make_record(
                4, half_width=2.0, energy=2.0, certified=False, status="saddle", negative_eigenvalues=None
            )
        )
    return ribbon_cli.open("mobius", runs=tmp_path / "runs")


# --- the module ---


def test_a_star_import_leaves_pythons_own_open():
    names: dict[str, object] = {}
    exec("from ribbon_cli import *", names)
    assert "open" not in names
    assert set(ribbon_cli.__all__) <= names.keys()
    assert {"open", *ribbon_cli.__all__} <= set(dir(ribbon_cli))
    assert all(hasattr(ribbon_cli, name) for name in dir(ribbon_cli))


def test_opening_a_run_loads_no_numerical_libraries(stored):
    code = (
        "import sys, ribbon_cli as ribbon\n"
        "assert not [name for name in sys.modules if name.startswith('ribbon_cli.')]\n"
        f"run = ribbon.open({str(stored.path)!r})\n"
        "assert len(run.states()) == 3\n"
        "heavy = {'numpy', 'scipy', 'h5py', 'pandas', 'xarray', 'matplotlib', 'qdldl'}\n"
        "sys.exit(str(heavy & sys.modules.keys()) if heavy & sys.modules.keys() else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- opening ---


def test_a_run_is_opened_by_whatever_names_it(stored, monkeypatch):
    root = stored.path.parent
    monkeypatch.setenv("RIBBON_RUNS", str(root))
    outcome = Outcome(ribbon_cli.Run(stored.path), (), (), 0)
    for named in ("mobius", "mob", stored.name, str(stored.path), stored.path, outcome.run, stored):
        found = ribbon_cli.open(named)
        assert isinstance(found, OpenRun)
        assert found.path == stored.path
    assert isinstance(stored, ribbon_cli.Run)


def test_what_names_no_run_is_refused(stored):
    root = stored.path.parent
    with pytest.raises(UsageError, match="did you mean mobius"):
        ribbon_cli.open("mobios", runs=root)
    with pytest.raises(UsageError, match="names a state: open its run"):
        ribbon_cli.open("mobius@b=1", runs=root)
    with pytest.raises(UsageError, match="not a run folder"):
        ribbon_cli.open(root)
    with pytest.raises(TypeError, match="run must be text or a path, got int"):
        ribbon_cli.open(3)


# --- tables ---


def flattened(row):
    """A row of `ribbon ls --json` without groups."""
    flat = {name: tuple(value) if isinstance(value, list) else value for name, value in row.items()}
    topology = flat.pop("topology")
    del flat["parameters"]  # the half-width, and none that varies
    return flat | topology


@pytest.mark.parametrize("everything", [False, True])
def test_a_table_holds_what_ls_lists(stored, everything):
    listed = ribbon_json("ls", "mobius", "--runs", stored.path.parent, *["--all"] * everything)
    table = stored.table(all=everything)
    assert set(table.columns) == flattened(listed[0]).keys()
    for row, state in zip(table.to_dict("records"), listed, strict=True):
        known = {
            key: None if np.ndim(value) == 0 and pandas.isna(value) else value for key, value in row.items()
        }
        assert known == flattened(state)
    assert table["certified"].dtype == bool
    assert table["half_width"].dtype == float
    assert table["negative_eigenvalues"].isna().sum() == 1
    assert table["negative_eigenvalues"].dtype == "Int64"


def test_a_table_of_a_branch_has_its_points(tmp_path):
    run = ribbon_cli.open(ribbon_cli.solve(parse_config(QUICK_BRANCH, "test"), runs=tmp_path).run)
    table = run.table(all=True)
    on_branch = table[table["branch_name"].notna()]
    assert set(on_branch["branch_type"]) >= {"step", "width"}
    assert on_branch["branch_arclength"].is_monotonic_increasing
    assert table["branch_index_before"].dtype == "Int64"
    assert (run.table()["kind"] == "equilibrium").all()


def test_an_empty_table_has_its_columns(tmp_path, stored):
    make_run(tmp_path / "runs", name="empty", hash8="89abcdef")
    table = ribbon_cli.open("empty", runs=tmp_path / "runs").table()
    assert len(table) == 0
    assert table.dtypes.equals(stored.table().dtypes)


def test_a_damaged_state_has_no_certificate_in_a_table(stored):
    stored.state_path(2).write_bytes(b"x")
    with pytest.warns(RibbonWarning, match=r"0002\.h5: damaged"):
        table = stored.table()
    row = table[table["label"] == 2].iloc[0]
    assert (row["status"], row["certified"]) == ("damaged", False)
    assert "1 with files lost or damaged" in repr(stored)
    with pytest.raises(StoreError, match="damaged"):
        stored.to_xarray()
    with pytest.raises(StoreError, match="damaged"):
        stored.at(b=1.0, N=10)


@pytest.mark.parametrize("library", ["pandas", "xarray"])
def test_a_library_that_is_not_installed_is_named(library, stored, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(
        ImportError, match=rf"needs {library}, which is not installed: `pip install"
    ) as raised:
        stored.table() if library == "pandas" else stored.to_xarray()
    assert "\n" not in str(raised.value)
    assert stored.at(b=1.0, N=10).energy == 1.0


def test_a_convergence_table_is_that_of_the_command(solved):  # noqa: F811
    table = ribbon_cli.open("mobius", runs=solved).convergence()
    document = ribbon_json("convergence-table", "mobius", "--runs", solved)
    rows = [dataclasses.asdict(row) for row in table.rows]
    assert [row.pop("doubtful") for row in rows] == [False] * len(rows), "which documents leave to notes"
    limits = [dataclasses.asdict(item) for item in table.extrapolations]
    assert {row.pop("others") for row in (*rows, *limits)} == {()}, "parameters that rows differ in"
    assert rows == document["rows"]
    assert limits == document["extrapolation"]


# --- grids ---


def test_a_grid_has_the_runs_energies(solved):  # noqa: F811
    run = ribbon_cli.open("mobius", runs=solved)
    grid = run.to_xarray()
    assert grid.energy.dims == ("half_width", "segments")
    for state in run.states():
        cell = grid.sel(half_width=state.half_width, segments=state.segments)
        assert float(cell.energy) == state.energy
        assert int(cell.label) == state.label
        assert str(cell.content_sha256.item()) == state.content_sha256
        record = run.load(state.label)
        for spectrum in record.spectra:
            values = cell.eigenvalue.sel(metric=spectrum.metric).to_numpy()
            assert np.array_equal(values, spectrum.values[: values.size])
            names = cell.mode_label.sel(metric=spectrum.metric).to_numpy()
            assert tuple(names) == spectrum.labels[: values.size]
    assert set(grid.attrs) == {"run"}


def test_where_a_state_is_missing_nothing_is_made_up(stored):
    grid = stored.to_xarray(modes=2)
    assert grid.half_width.dtype == np.float64
    assert grid.half_width.to_numpy().tolist() == [1.0, 2.0]
    hole = grid.sel(half_width=2.0, segments=20)
    for name in ("energy", "label", "self_contact", "newton_steps", "clearance"):
        assert math.isnan(hole[name]), name
    assert np.isnan(hole.eigenvalue).all()
    assert not hole.certified
    assert str(hole.status.item()) == ""
    assert grid.certified.dtype == bool
    assert grid.certified.to_numpy().tolist() == [[True, True], [False, False]]
    assert grid.self_contact.to_numpy().tolist()[0] == [0.0, 1.0]
    assert math.isnan(grid.sel(half_width=2.0, segments=10).negative_eigenvalues)
    assert "eigenvalue" not in stored.to_xarray(modes=0)


def test_facts_of_states_survive_a_concatenation(stored):
    """They are variables: of attributes the first run's alone would be left."""
    both = xarray.concat([stored.to_xarray(), stored.to_xarray()], "copy")
    assert both.content_sha256.shape == (2, 2, 2)


def test_two_states_of_one_width_and_mesh_are_both_there(stored):
    with stored.writing():
        stored.commit(make_record(5, half_width=1.0, energy=3.0))
        stored.commit(make_record(6, half_width=2.0 * (1.0 + 1e-12), segments=10, energy=4.0))
    rows = stored.to_xarray()
    assert rows.energy.dims == ("label",)
    assert rows.label.to_numpy().tolist() == [2, 3, 4, 5, 6]
    assert rows.half_width.to_numpy().tolist() == [1.0, 1.0, 2.0, 1.0, 2.0 * (1.0 + 1e-12)]
    grid = stored.to_xarray(grid=True)
    assert grid.half_width.size == 2
    for b in (1.0, 2.0):
        assert float(grid.energy.sel(half_width=b, segments=10)) == stored.at(b=b, N=10).energy


def test_a_run_without_equilibria_has_no_grid(tmp_path):
    made = make_run(tmp_path, name="empty")
    with pytest.raises(UsageError, match="has no equilibria yet"):
        OpenRun.of(made).to_xarray()


# --- states ---


@pytest.mark.parametrize(
    "wanted", [{"b": 1.0}, {"N": 10}, {"b": 1.0, "N": 20}, {"b": 2}, {"b": np.float64(2.0)}]
)
def test_at_takes_what_a_reference_takes(wanted, stored, recwarn):
    query = ",".join(f"{key}={value}" for key, value in wanted.items())
    shown = ribbon("show", f"mobius@{query}", "--json", "--runs", stored.path.parent)
    state = stored.at(**wanted)
    assert state.label == json.loads(shown.stdout)["label"]
    assert state.choice == shown.stderr.strip().partition(": ")[2]
    assert [str(w.message) for w in recwarn] == [f"{stored.name}: {state.choice}"] * (not state.certified)


def test_at_says_what_there_is(stored):
    with pytest.raises(UsageError, match="no equilibrium with b = 3: it has b = 1, 2"):
        stored.at(b=3)
    with pytest.raises(UsageError, match="needs b, N or both"):
        stored.at()
    with pytest.raises(TypeError, match="b must be a number, got '1'"):
        stored.at(b="1")
    with pytest.raises(TypeError):
        stored.at(N=10.0)
    with pytest.raises(UsageError, match="no state 9"):
        stored.state(9)


def test_a_state_is_its_record_and_knows_its_place(stored):
    state = stored.state(1)
    assert isinstance(state, StateRecord)
    record = decode(stored.state_path(1))
    assert content_sha256(state) == content_sha256(record)
    for field in dataclasses.fields(record):
        here, there = getattr(state, field.name), getattr(record, field.name)
        assert (
            np.array_equal(here, there)
            if isinstance(here, np.ndarray)
            else field.name == "spectra" or here == there
        )
    assert (state.path, state.run.path, state.choice) == (stored.state_path(1), stored.path, "")
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.energy = 0.0


def test_a_state_goes_to_another_process_without_its_runs_log(stored):
    state = stored.at(b=1.0)
    sent = pickle.dumps(state)
    assert b"twist 1/2" not in sent
    there = pickle.loads(sent)
    assert (there.label, there.choice, there.path) == (state.label, state.choice, state.path)
    assert there.run.at(b=1.0).energy == state.energy


def test_a_changed_copy_has_no_place(stored):
    copy = dataclasses.replace(stored.at(b=1.0), energy=7.0)
    assert (copy.energy, copy.run, copy.choice) == (7.0, None, "")
    assert "E = 7," in repr(copy)


def test_a_state_outside_of_a_run_is_drawn_and_not_refined(stored, tmp_path):
    path = tmp_path / "copy.h5"
    path.write_bytes(stored.state_path(2).read_bytes())
    state = ribbon_cli.load_state(path)
    assert isinstance(state, OpenState)
    assert state.run is None
    assert repr(state).startswith("<state state 2, b = 1, N = 10")
    with pytest.raises(UsageError, match="not in a run: refine adds its results"):
        state.refine(20)
    with pytest.raises(UsageError, match="not in a run: follow adds its results"):
        state.follow(2.0)


def test_a_spectrum_is_that_of_the_command(solved):  # noqa: F811
    state = ribbon_cli.open("mobius", runs=solved).at(b=0.2, N=24)
    spectrum = state.spectrum(modes=4)
    words = ("spectrum", "mobius@b=0.2,N=24", "--modes", "4", "--runs", solved)
    assert spectrum.document() == ribbon_json(*words)
    table = spectrum.table()
    assert table["value"].tolist() == spectrum.values.tolist()
    assert table["label"].tolist() == list(spectrum.labels)
    assert len(spectrum.bounds) == len(table)
    assert spectrum.to_xarray().vector.shape == (7, 24, 7)
    assert spectrum.stability == "stable"
    assert spectrum.verdict in repr(spectrum)
    assert spectrum.verdict in spectrum._repr_html_()


# --- pictures and exports ---


def test_a_picture_is_that_of_the_command(solved, tmp_path):  # noqa: F811
    from ribbon_cli.plot.figure import image
    from ribbon_cli.plot.style import STYLES

    run = ribbon_cli.open("mobius", runs=solved)
    for ref, kind, figure in (
        ("mobius@b=0.2,N=24", "shape", run.at(b=0.2, N=24).plot()),
        ("mobius", "convergence", run.plot("convergence")),
    ):
        path = tmp_path / f"{kind}.png"
        document = ribbon_json("plot", ref, kind, "-o", path, "--runs", solved)
        title = figure.get_supxlabel().replace("\n", " ").partition(". ")[0]
        assert image(figure, "png", STYLES["paper"], title, document["caption"]) == path.read_bytes()


def test_a_picture_shows_itself(solved):  # noqa: F811
    state = ribbon_cli.open("mobius", runs=solved).at(b=0.2, N=24)
    data, size = state.plot("shape", caption=False, width=60)._repr_png_()
    assert data.startswith(b"\x89PNG")
    assert size["width"] == round(96 * 60 / 25.4)
    assert int.from_bytes(data[16:20], "big") == pytest.approx(2 * size["width"], abs=2)


def test_pictures_refuse_what_the_command_refuses(solved):  # noqa: F811
    run = ribbon_cli.open("mobius", runs=solved)
    state = run.at(b=0.2, N=24)
    with pytest.raises(UsageError, match="did you mean shape"):
        state.plot("shap")
    with pytest.raises(UsageError, match="does nothing for geometry"):
        state.plot("geometry", view=(30.0, 20.0))
    with pytest.raises(UsageError, match="shape shows one state: name one of"):
        run.plot("shape")
    with pytest.raises(UsageError, match="no style"):
        state.plot(style="poster")


def test_an_export_is_that_of_the_command(solved, tmp_path):  # noqa: F811
    run = ribbon_cli.open("mobius", runs=solved)
    state = run.at(b=0.2, N=24)
    for form, source in (("stl", state), ("npz", state), ("vtkhdf", run)):
        ref = "mobius" if source is run else "mobius@b=0.2,N=24"
        path, own = tmp_path / f"command.{form}", tmp_path / f"own.{form}"
        words = ("export", ref, "--to", form, "-o", path, "--runs", solved)
        document = ribbon_json(*words)
        done = source.export(own)
        assert own.read_bytes() == path.read_bytes()
        assert done.paths == (str(own),)
        facts = dataclasses.asdict(done.facts) if done.facts else {}
        assert facts == {key: document[key] for key in facts}
    with pytest.raises(UsageError, match=r"exists already and is not replaced: pass overwrite=True"):
        state.export(own)
    with pytest.raises(UsageError, match="did you mean stl"):
        state.export(tmp_path / "band.slt")
    with pytest.raises(UsageError, match="its suffix names the format"):
        state.export(tmp_path / "band")
    with pytest.raises(UsageError, match="--thickness does nothing for obj"):
        state.export(tmp_path / "band.obj", thickness=2.0)
    with pytest.raises(UsageError, match="its suffix is that of the format obj, and stl is asked for"):
        state.export(tmp_path / "band.obj", format="stl")
    assert state.export(tmp_path / "band", format="csv").format == "csv"
    with pytest.raises(UsageError, match=r"no parameter 'n'; did you mean N\?"):
        run.at(n=24)
    command = ribbon("export", "mobius@b=0.2,N=24", "-o", tmp_path / "suffix.npz", "--runs", solved)
    assert command.exit_code == 0
    assert (tmp_path / "suffix.npz").read_bytes() == (tmp_path / "own.npz").read_bytes()


def test_a_band_that_meets_itself_is_warned_of(stored, tmp_path):
    with pytest.warns(RibbonWarning, match="touches or passes through itself") as seen:
        done = stored.state(3).export(tmp_path / "band.csv")
    assert MEETS_ITSELF in done.warning
    with pytest.warns(RibbonWarning, match="touches or passes through itself") as drawn:
        stored.state(3).plot("geometry")
    assert {Path(w.filename) for w in (*seen, *drawn)} == {Path(__file__)}


# --- more states ---


def test_a_refinement_joins_the_run_and_is_solved_for_once(own):
    events: list[object] = []
    finer = own.at(b=0.2, N=24).refine(32, progress=events.append)
    assert (finer.segments, finer.certified, finer.run.path) == (32, True, own.path)
    assert own.at(b=0.2, N=32).label == finer.label
    assert isinstance(events[0], Stage)
    assert any(isinstance(event, Step) for event in events)
    assert own.at(b=0.2, N=24).refine(32).label == finer.label
    with pytest.raises(UsageError, match="at least 8 segments"):
        finer.refine(4)


def test_a_refinement_that_fails_is_no_state(own, monkeypatch):
    state = own.at(b=0.2, N=24)
    missed = Target(0.2, 48, None, False, False, "not reached: stalled")
    saddle = Target(0.2, 48, state.label, True, False, "a saddle of index 1")
    for target in (missed, saddle):
        outcome = Outcome(own, (target,), (), 0)
        monkeypatch.setattr("ribbon_cli.study.refine.refine_state", lambda *a, _o=outcome, **k: _o)
        if target is missed:
            with pytest.raises(TargetError, match=r"b = 0\.2, N = 48: not reached: stalled"):
                state.refine(48)
        else:
            with pytest.warns(RibbonWarning, match="a saddle of index 1"):
                assert state.refine(48).label == state.label


def test_a_branch_is_followed(own):
    state = own.at(b=0.2, N=24)
    followed = state.follow(0.22, arclength=True)
    (branch,) = followed.branches
    assert followed.outcome.new_states > 0
    assert branch.half_width == 0.22
    table = followed.table()
    assert table["label"].tolist() == [point.label for point in branch.points]
    assert table["half_width"].is_monotonic_increasing
    assert table["negative_eigenvalues"].dtype == "Int64"
    assert followed.states[-1].half_width == 0.22
    assert branch.message in repr(followed)
    assert str(branch.points[0].label) in followed._repr_html_()
    assert state.follow(0.22, arclength=True).outcome.new_states == 0
    assert own.at(b=0.22).label == followed.states[-1].label


def test_following_refuses_what_the_command_refuses(own):
    state = own.at(b=0.2, N=24)
    with pytest.raises(UsageError, match="--back-to needs --arclength"):
        state.follow(0.3, back_to=0.1)
    with pytest.raises(UsageError, match="did you mean fold"):
        state.follow(0.3, arclength=True, stop_at=("folds",))
    with pytest.raises(UsageError, match="--max-step: must be positive, got -1"):
        state.follow(0.3, arclength=True, max_step=-1.0)
    with pytest.raises(UsageError, match=r"has b = 0\.2 already"):
        state.follow(0.2)


def test_a_locked_run_is_told(own):
    with own.writing(), pytest.raises(LockedError):
        own.at(b=0.2, N=24).refine(36)


# --- progress ---


def test_a_watcher_gets_every_event(tmp_path):
    events: list[object] = []
    ribbon_cli.solve(parse_config(QUICK_RING, "test"), runs=tmp_path, progress=events.append)
    stages = [event for event in events if isinstance(event, Stage)]
    assert [stage.index for stage in stages] == list(range(1, len(stages) + 1))
    assert {type(event) for event in events} <= {Stage, Step, Note}
    assert str(stages[0]).startswith("[1/")
    assert str(Step(2, 1.25, 3e-12)) == "step 2: E = 1.250000000, residual 3.0e-12"
    assert str(Note("a saddle was left")) == "a saddle was left"


def test_progress_is_silent_unless_asked_for(tmp_path, capsys):
    config = parse_config(QUICK_RING, "test")
    ribbon_cli.solve(config, runs=tmp_path / "a")
    assert capsys.readouterr() == ("", "")
    ribbon_cli.solve(config, runs=tmp_path / "b", progress=True)
    seen = capsys.readouterr()
    assert seen.out == ""
    assert "b = 0.5, N = 24" in seen.err
    with pytest.raises(TypeError, match="progress must be a callable, True or None, got int"):
        ribbon_cli.solve(config, runs=tmp_path / "c", progress=3)


def test_what_a_watcher_raises_ends_the_solve_and_keeps_what_is_stored(tmp_path):
    config = parse_config(QUICK_RING, "test")

    def stop(event: object) -> None:
        if isinstance(event, Stage) and event.index == 3:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        ribbon_cli.solve(config, runs=tmp_path, progress=stop)
    run = ribbon_cli.open("ring", runs=tmp_path)
    assert len(run.states()) == 2
    assert ribbon_cli.solve(config, runs=tmp_path).new_states == 2


# --- display ---


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "certified minimum"),
        ({"certified": False, "status": "stalled"}, "equilibrium, stalled: no certificate"),
        ({"kind": "auxiliary"}, "auxiliary, minimum of the auxiliary problem: no equilibrium of the band"),
    ],
)
@pytest.mark.parametrize("meets", [True, False])
def test_the_certificate_is_always_said(changes, words, meets, tmp_path):
    made = make_run(tmp_path)
    with made.writing():
        made.commit(make_record(1, self_contact=meets, **changes))
    run = OpenRun.of(made)
    state = run.state(1)
    for text in (repr(state), state._repr_html_()):
        assert words in text
        assert (MEETS_ITSELF in text) == meets
    if state.kind == "equilibrium":
        certified = int(state.certified)
        for text in (repr(run), run._repr_html_()):
            assert f"{certified} of 1 equilibria certified" in text
            assert f"{'1' if meets else 'none'} in self-contact" in text
        assert ("no certificate" in run._repr_html_()) == (not certified)
        assert (MEETS_ITSELF in run._repr_html_()) == meets


def test_the_display_of_a_long_run_lists_its_last_states(tmp_path):
    run = OpenRun.of(make_run(tmp_path, 15))
    page = run._repr_html_()
    assert page.count("<tr>") == 13
    assert "`run.table()` has 3 before them" in page
    assert "no equilibria, 0 other states" in repr(OpenRun.of(make_run(tmp_path, 0, "empty")))


def test_a_display_obeys_nobody(tmp_path):
    made = make_run(tmp_path)
    with made.writing():
        made.commit(make_record(1, stage=f"<script>{ESCAPE}[2J", status="<b>"))
    run = OpenRun.of(made)
    for shown in (run, run.state(1)):
        assert ESCAPE not in repr(shown) + shown._repr_html_()
        assert "<script>" not in shown._repr_html_()
        assert "<b>" not in shown._repr_html_()


def test_a_damaged_log_is_said_and_raises_nothing_in_a_display(stored):
    data = stored.log_path.read_bytes().splitlines(keepends=True)
    stored.log_path.write_bytes(b"".join([data[0], b"x\n", *data[1:]]))
    run = ribbon_cli.open(stored.path)
    assert "damaged" in repr(run)
    assert "damaged" in run._repr_html_()
    with pytest.raises(StoreError):
        run.table()
