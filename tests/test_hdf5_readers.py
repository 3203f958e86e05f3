"""HDF5 files as other programs read them: h5py, xarray with both of its engines, and h5dump.

Those that the program writes are states, packs and VTKHDF.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from cli_support import ribbon, ribbon_json
from picture_support import run_named, solved  # noqa: F401

from ribbon_cli.store import Run, content_sha256, decode, encode
from ribbon_cli.store.layout import DIMENSIONS

DATA = Path(__file__).parent / "data"
FROZEN = DATA / "format-1.1" / "frozen-branch-e83cb1ed"
OLD_PACK = DATA / "pack-1.0" / "frozen-branch.pack.h5"
FILES = ("state", "auxiliary", "branch", "in-two-pieces", "pack", "vtkhdf", "series")
QUICK, LONG = ("state", "pack"), ("auxiliary", "branch", "in-two-pieces", "vtkhdf", "series")
WITHOUT_SCALES = ("vtkhdf", "series")
ENGINES: dict[str, dict[str, Any]] = {"h5netcdf": {"phony_dims": "access"}, "netcdf4": {}}
"""xarray's engines for HDF5; axes without a scale get names that h5netcdf wants to be asked for."""
EACH_ENGINE = ["h5netcdf", pytest.param("netcdf4", marks=pytest.mark.peers)]


@pytest.fixture(scope="module")
def files(solved: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:  # noqa: F811
    """One file of each kind, by its name in FILES."""
    folder = tmp_path_factory.mktemp("hdf5")
    paths = {name: folder / f"{name}.h5" for name in FILES}
    run = run_named(solved, "mobius")
    kinds = {state.kind: run.state_path(state.label) for state in run.states(all=True)}
    shutil.copy(kinds["equilibrium"], paths["state"])
    shutil.copy(kinds["auxiliary"], paths["auxiliary"])
    paths["branch"].write_bytes(encode(Run.open(FROZEN).load(2)))
    paths["in-two-pieces"].write_bytes(encode(decode(DATA / "format-1.1" / "in-two-pieces.h5")))
    for words in (
        ("pack", FROZEN.name, "-o", paths["pack"], "--runs", FROZEN.parent),
        ("export", "mobius@b=0.2,N=24", "--to", "vtkhdf", "-o", paths["vtkhdf"], "--runs", solved),
        ("export", "mobius", "--to", "vtkhdf", "-o", paths["series"], "--runs", solved),
    ):
        ribbon_json(*words)
    return paths


def objects(file: h5py.Group, kind: type[Any]) -> dict[str, Any]:
    """Groups or datasets of a file, by path."""
    found: dict[str, Any] = {}
    file.visititems(lambda path, item: found.update({path: item}) if isinstance(item, kind) else None)
    return found


def axes(file: h5py.Group) -> dict[str, list[list[str]]]:
    """For each array but the scales, the paths of what is attached to each axis, as h5py follows it."""
    return {
        path: [[scale.name for scale in dim.values()] for dim in item.dims]
        for path, item in objects(file, h5py.Dataset).items()
        if item.shape and not item.is_scale and not path.startswith("files/")
    }


@pytest.mark.parametrize("name", FILES)
def test_h5py_reads_all_and_finds_each_axis_its_scale(name, files):
    with h5py.File(files[name]) as file:
        for item in objects(file, h5py.Dataset).values():
            item[()]
        found = axes(file)
        assert len(found) > 10
        for path, scales in found.items():
            array = file[path]
            assert len(scales) == array.ndim
            for axis, attached in enumerate(scales):
                if name in WITHOUT_SCALES:
                    assert attached == []
                    continue
                (scale,) = attached
                group, _, dimension = scale.rpartition("/")
                assert group == array.parent.name
                assert dimension in DIMENSIONS
                assert file[scale].shape == (array.shape[axis],)


@pytest.mark.parametrize("kind", ["auxiliary", "equilibrium"])
def test_a_pack_attaches_what_its_states_do(kind, solved, tmp_path):  # noqa: F811
    run = run_named(solved, "mobius")
    ribbon_json("pack", "mobius", "-o", tmp_path / "pack.h5", "--runs", solved)
    label = max(state.label for state in run.states(all=True) if state.kind == kind)
    copy = f"states/{label:04d}"
    with h5py.File(tmp_path / "pack.h5") as pack, h5py.File(run.state_path(label)) as state:
        within = {path: [[f"/{copy}{s}" for s in dim] for dim in dims] for path, dims in axes(state).items()}
        assert axes(pack[copy]) == within
        assert len(within) > 15


@pytest.mark.parametrize("engine", EACH_ENGINE)
@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(f, marks=pytest.mark.long) for f in LONG)])
def test_xarray_reads_every_group(name, engine, files):
    with h5py.File(files[name]) as file:
        arrays = {path: item[()] for path, item in objects(file, h5py.Dataset).items()}
        groups = {path: list(item) for path, item in objects(file, h5py.Group).items()}
        names = {
            path: [scale.rpartition("/")[2] for dim in dims for scale in dim]
            for path, dims in axes(file).items()
        }
    opened = xarray.open_groups(files[name], engine=engine, **ENGINES[engine])
    for group, members in groups.items():
        data = opened.pop(f"/{group}")
        found = {member: arrays.get(f"{group}/{member}") for member in members}
        assert set(data.variables) == {member for member, values in found.items() if values is not None}
        for member, values in found.items():
            if values is not None and values.dtype.kind in "fiu":
                np.testing.assert_array_equal(data[member].to_numpy(), values)
            if scales := names.get(f"{group}/{member}"):
                assert data[member].dims == tuple(scales)
        data.close()
    opened.pop("/").close()
    assert opened == {}


@pytest.mark.parametrize("engine", EACH_ENGINE)
def test_xarray_takes_a_packed_state_as_the_state(engine, files):
    record = Run.open(FROZEN).load(2)
    n, within = record.segments, "states/0002"
    with xarray.open_dataset(files["pack"], group=f"{within}/state", engine=engine) as data:
        assert dict(data.sizes) == {"node": n, "facet": n, "xyz": 3}
        np.testing.assert_allclose(data["node"], np.arange(n) * record.length / n, rtol=1e-15)


def test_an_old_pack_gives_its_run_still(tmp_path, monkeypatch):
    """Format 1.0 of packs, whose copies have lost their scales: the run is whole, and packed anew they are
    there.
    """
    monkeypatch.chdir(tmp_path)
    assert ribbon_json("unpack", OLD_PACK, "--runs", "runs")["states"] == 2
    for path in FROZEN.rglob("*.*"):
        unpacked = tmp_path / "runs" / FROZEN.name / path.relative_to(FROZEN)
        assert unpacked.read_bytes() == path.read_bytes()
    assert ribbon("verify", "all").exit_code == 0
    result = ribbon("show", str(OLD_PACK))
    assert result.exit_code == 4
    assert "a packed run, not a state: `ribbon unpack`" in result.stderr
    ribbon_json("pack", "frozen-branch", "-o", "new.h5")
    with h5py.File("new.h5") as file:
        assert file.attrs["format_version"] == b"1.1"
        assert file["states/0002/state/u"].dims[0]["facet"].shape == (8,)
        assert file["states/0002"].attrs["content_sha256"].decode() == content_sha256(
            decode(FROZEN / "states" / "0002.h5")
        )


@pytest.mark.readers
@pytest.mark.parametrize("name", FILES)
def test_h5dump_prints_it_without_a_word_of_complaint(name, files):
    program = shutil.which("h5dump")
    assert program, "this test needs HDF5's own tools: apt install hdf5-tools"
    for options in (["-H"], []):
        done = subprocess.run(
            [program, *options, files[name]], capture_output=True, text=True, timeout=100, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("HDF5 ")
    # Of an attachment that leads nowhere it prints numbers and no name, and exits with 0.
    lists = re.findall(r'"DIMENSION_LIST" \{.*?DATA \{(.*?)\}', done.stdout, re.DOTALL)
    assert bool(lists) == (name not in WITHOUT_SCALES)
    named = r'\(\d+\):|\(DATASET \d+ "/[\w./]+"\)|[\s,]'
    assert [re.sub(named, "", text) for text in lists] == [""] * len(lists)
