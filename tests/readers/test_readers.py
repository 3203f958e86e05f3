"""Exports in the readers of their formats' authors, which run in Node.js: `make test-readers`."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.export.fold import fold_bytes
from ribbon_cli.export.gltf import glb_bytes
from ribbon_cli.store import StateRecord

pytestmark = pytest.mark.readers
HERE = Path(__file__).parent


@pytest.fixture(params=["mobius", "ring", "open"])
def state(request: pytest.FixtureRequest, solved: Path) -> StateRecord:  # noqa: F811
    """A one-sided band, a two-sided one, and a strip whose seam is open."""
    if request.param == "open":
        return states_of(solved, "mobius", "auxiliary")[4]
    return states_of(solved, request.param)[-1]


def said(script: str, path: Path) -> dict[str, Any]:
    """What a script says of a file."""
    node = shutil.which("node")
    assert node, "these tests need Node.js: apt install npm"
    done = subprocess.run([node, HERE / script, path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_fold_is_read_by_its_own_library(state, tmp_path):
    path = tmp_path / "band.fold"
    path.write_bytes(fold_bytes(state, "a band", None))
    written, found = json.loads(path.read_bytes()), said("check-fold.cjs", path)
    n = state.segments
    assert len(found["faces"]) == n
    # From wherever a face begins, it goes round the same way.
    turned = [{tuple(face[k:] + face[:k]) for k in range(4)} for face in found["faces"]]
    assert all(sum(tuple(face) in ways for ways in turned) == 1 for face in written["faces_vertices"])
    assert found["orientations"] == [1] * n
    assert found["crossings"] == 0
    assert found["edges"] == [len(written["edges_vertices"])] * 2 == [3 * n + 1] * 2
    assert found["boundary"] == found["borders"] == 2 * n + 2
    assert (found["mountains"], found["valleys"]) == tuple(map(written["edges_assignment"].count, "MV"))
    assert found["mountains"] + found["valleys"] > 0
    np.testing.assert_allclose(*found["lengths"], atol=1e-9)
    # The library's angles are arc cosines, which are rough where there is little fold.
    np.testing.assert_allclose(found["angles"], written["edges_foldAngle"], atol=1e-4)
    assert found["converted"] > 1000


def test_glb_has_no_fault(state, tmp_path):
    path = tmp_path / "band.glb"
    path.write_bytes(glb_bytes(state, "a band", None))
    report = said("check-gltf.cjs", path)
    counts = {name: report["issues"][name] for name in ("numErrors", "numWarnings", "numInfos", "numHints")}
    assert set(counts.values()) == {0}, report["issues"]["messages"]
    assert report["info"]["totalTriangleCount"] == 2 * state.segments
