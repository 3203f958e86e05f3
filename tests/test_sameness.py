"""Two records of one state: identical, the same to rounding, or different."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import QUICK_BRANCH, QUICK_MOBIUS, ribbon, ribbon_json

import ribbon_cli
from ribbon_cli.config.types import SpectrumRequest
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.symmetry import Symmetry
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.status import Result, Status
from ribbon_cli.store import Run, StateRecord, encode, write_atomic
from ribbon_cli.store.layout import BRANCH, REACTIONS, SPECTRUM, STATE
from ribbon_cli.study.clock import Clock
from ribbon_cli.study.records import Reached, build_record, multipliers_of, state_of
from ribbon_cli.verify.recompute import residuals
from ribbon_cli.verify.sameness import judge

HOW = {"label", "stage", "parent", "parent_ref", "method", "newton_steps", "events", "message", "name"}
"""Fields that say how a state was reached, and where it stands: no part of what it is."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Run:
    config = QUICK_MOBIUS.replace("full_up_to: 0", "full_up_to: 24")
    path = tmp_path_factory.mktemp("same") / "mobius.yaml"
    path.write_text(config)
    return ribbon_cli.solve(path, path.parent / "runs").run


@pytest.fixture(scope="module")
def branch(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = tmp_path_factory.mktemp("same") / "branch.yaml"
    path.write_text(QUICK_BRANCH)
    return ribbon_cli.solve(path, path.parent / "runs").run


@pytest.fixture(scope="module")
def minimum(made: Run) -> StateRecord:
    (state,) = (s for s in made.states() if s.half_width == 0.2 and s.segments == 24)
    return made.load(state.label)


def again(record: StateRecord, x: np.ndarray, multipliers: np.ndarray | None = None) -> StateRecord:
    """The record of a point: solved for where no multipliers are given, else as it is, its residuals those
    that it has."""
    problem = Problem(state_of(record).band)
    if multipliers is None:
        result = solve(problem, x, options=Options())
    else:
        local = problem.local_derivatives(x, multipliers)
        found = vars(residuals(problem, local, multipliers))
        result = Result(
            Status.MINIMUM, x, multipliers, problem.state(x), problem.energy(x), **found, negative=0, steps=1
        )
    reached = Reached(problem, result, record.kind, record.stage, record.method, record.half_twists)
    request = SpectrumRequest(modes=4, full_up_to=24, metrics=("euclidean", "physical"))
    return build_record(record.label, reached, Clock((), Path.cwd()), request)


def noise(record: StateRecord, size: float) -> np.ndarray:
    x = state_of(record).vector()
    move = np.random.default_rng(5).standard_normal(x.size)
    return x + size * move / np.abs(move).max()


def test_a_record_is_identical_to_itself_wherever_it_stands(minimum):
    assert judge(minimum, minimum).answer == "identical"
    elsewhere = replace(minimum, label=99, parent=98, provenance={"argv": "another"})
    assert judge(minimum, elsewhere).answer == "identical"


def test_a_state_reached_in_another_way_is_the_same_to_rounding(minimum):
    found = judge(minimum, replace(minimum, stage="branch up, step 3", method="arclength", newton_steps=3))
    assert found.answer == "same to rounding"
    assert found.largest_relative_difference == 0.0


def test_a_state_solved_for_again_from_nearby_is_the_same_to_rounding(minimum):
    found = judge(minimum, again(minimum, noise(minimum, 1e-3)))
    assert found.answer == "same to rounding"
    assert 0.0 < found.largest_relative_difference < 1e-7
    assert found.image in (None, "turned")


@pytest.mark.parametrize(("shift", "reverse"), [(0, False), (5, False), (24, False), (7, True)])
def test_an_image_is_the_same_to_rounding_and_said_to_be_one(minimum, shift, reverse):
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    image = Symmetry("image", turn, float(shift), reverse, False, 0.0, True)
    moved = image.apply(state_of(minimum).vector().reshape(-1, 7), -1)
    found = judge(minimum, again(minimum, moved.ravel()))
    assert found.answer == "same to rounding"
    assert found.largest_relative_difference < 1e-7
    assert "turned" in found.image
    assert ("backwards" in found.image) == reverse or shift == 7  # a symmetric shape has several names


@pytest.mark.parametrize("size", [1e-4, 1e-6, 1e-8])
def test_a_state_that_is_not_converged_is_different(minimum, size):
    found = judge(minimum, again(minimum, noise(minimum, size), multipliers_of(minimum)))
    assert found.answer == "different"


def test_a_state_one_newton_step_away_along_its_softest_mode_is_different(minimum):
    """The residual hardly tells: the shape does."""
    physical = next(s for s in minimum.spectra if s.metric == "physical")
    k = next(k for k, label in enumerate(physical.labels) if label != "rotation")
    mode = physical.vectors[k].ravel()
    x = state_of(minimum).vector() + 1e-6 * mode / np.abs(mode).max()
    off = again(minimum, x, multipliers_of(minimum))
    found = judge(minimum, replace(off, status=minimum.status, spectra=minimum.spectra))
    assert found.answer == "different"
    assert found.largest_in == "/certificate/kkt_residual"  # above the tolerance that the minimum meets
    multiplied = replace(off, kkt_residual=1e-10, status=minimum.status, spectra=minimum.spectra)
    assert judge(minimum, multiplied).largest_relative_difference == pytest.approx(1e-6, rel=0.5)


def test_a_state_that_states_smaller_residuals_than_it_has_is_different(minimum):
    off = again(minimum, noise(minimum, 3e-12), multipliers_of(minimum))
    lie = replace(off, kkt_residual=minimum.kkt_residual, constraint_residual=minimum.constraint_residual)
    found = judge(minimum, lie)
    assert found.answer == "different"
    assert found.largest_in.endswith("_residual")


def test_other_minima_are_different(made):
    records = [made.load(state.label) for state in made.states()]
    for k, one in enumerate(records):
        for two in records[:k]:
            assert judge(one, two).answer == "different"


def test_a_saddle_is_not_the_minimum_beside_it(made):
    saddles = [s for s in made.states(all=True) if s.kind == "saddle"]
    minima = made.states()
    for saddle in saddles:
        beside = [s for s in minima if s.half_width == saddle.half_width]
        assert all(judge(made.load(saddle.label), made.load(s.label)).answer == "different" for s in beside)


def forged(value: object) -> object:
    """Another value of the same kind, as far off as a real difference would be."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return value + 1e-3 * max(1.0, abs(value))
    if isinstance(value, str):
        return {"equilibrium": "saddle", "thesis": "value-average", "step": "width", "width": "step"}.get(
            value, "saddle"
        )
    changed = np.array(value, copy=True)
    flat = changed.reshape(-1)
    k = flat.size // 2
    flat[k] = not flat[k] if flat.dtype == bool else flat[k] + 1e-3 * max(1.0, float(np.abs(flat).max()))
    return changed


OF_STRIPS = {"bending_energy", "lambda_end", "sigma", *REACTIONS}
"""Fields that closed bands have not, or only together with others: see test_strip_checks.py."""


@pytest.mark.parametrize(
    "name", [item.field for item in STATE if item.field not in HOW | {"segments"} | OF_STRIPS]
)
def test_every_field_that_says_what_a_state_is_is_looked_at(minimum, name):
    value = getattr(minimum, name)
    if value is None:
        value = {"cut_node": 3, "g_cut": np.ones(3), "seam_open": True, "prescribed": np.ones(24, bool)}[name]
        other = replace(minimum, **{name: value})
        assert judge(minimum, other).answer == ("same to rounding" if name == "g_cut" else "different")
        return
    assert judge(minimum, replace(minimum, **{name: forged(value)})).answer == "different"


@pytest.mark.parametrize("name", [item.field for item in SPECTRUM])
@pytest.mark.parametrize("place", [0, 1])
def test_every_field_of_a_spectrum_is_looked_at(minimum, name, place):
    spectra = list(minimum.spectra)
    if name == "labels":
        changed: object = ("mode", *spectra[place].labels[1:])
    elif name == "vectors":
        changed = spectra[place].vectors.copy()
        changed[-2] = np.roll(changed[-2], 1, axis=0)
    elif name == "residuals":
        changed = spectra[place].residuals + 1e-2 * np.abs(spectra[place].values).max()
    else:
        changed = forged(getattr(spectra[place], name))
    spectra[place] = replace(spectra[place], **{name: changed})
    assert judge(minimum, replace(minimum, spectra=tuple(spectra))).answer == "different"


def test_a_spectrum_that_one_record_has_not_makes_them_different(minimum):
    assert judge(minimum, replace(minimum, spectra=())).answer == "different"


@pytest.mark.parametrize("name", [item.field for item in BRANCH if item.field not in HOW])
def test_every_field_of_a_point_on_a_branch_is_looked_at(branch, name):
    point = next(branch.load(s.label) for s in branch.states() if branch.load(s.label).branch)
    value = getattr(point.branch, name)
    if name == "soft_mode":
        value = point.branch.tangent
    absent = "shear" if name == "parameter" else 1
    changed = absent if value is None else value if name == "soft_mode" else forged(value)
    other = replace(point, branch=replace(point.branch, **{name: changed}))
    assert judge(point, other).answer == "different"


def test_modes_are_the_same_up_to_sign_and_rotation_in_a_multiple_eigenvalue(minimum):
    spectra = []
    for spectrum in minimum.spectra:
        vectors = spectrum.vectors.copy()
        vectors[3:] *= -1.0
        vectors[:2] = np.einsum("ij,jkl->ikl", [[0.6, 0.8], [-0.8, 0.6]], vectors[:2])  # rotations, all zero
        spectra.append(replace(spectrum, vectors=vectors))
    assert judge(minimum, replace(minimum, spectra=tuple(spectra))).answer == "same to rounding"


@pytest.fixture
def files(minimum, tmp_path, monkeypatch) -> Callable[[StateRecord], tuple[str, str]]:
    monkeypatch.chdir(tmp_path)

    def write(other: StateRecord) -> tuple[str, str]:
        for name, record in (("one.h5", minimum), ("two.h5", other)):
            write_atomic(name, encode(record), overwrite=True)
        return "one.h5", "two.h5"

    return write


def test_compare_says_which_of_the_three_and_exits_by_it(files, minimum):
    pair = files(again(minimum, noise(minimum, 1e-3)))
    result = ribbon("compare", *pair)
    assert result.exit_code == 0
    last = result.stdout.splitlines()[-1]
    assert last.startswith("same to rounding (largest relative difference ")
    assert ribbon("compare", *pair, "--exact").exit_code == 3
    document = ribbon_json("compare", *pair)
    assert document["answer"] == "same to rounding"
    assert 0.0 < document["largest_relative_difference"] < 1e-7
    assert document["largest_in"].startswith("/")
    assert not document["equal"]
    pair = files(minimum)
    assert ribbon("compare", *pair, "--exact").stdout == "identical\n"
    pair = files(replace(minimum, energy=minimum.energy * (1.0 + 1e-9)))
    result = ribbon("compare", *pair)
    assert result.exit_code == 3
    assert (
        result.stdout.splitlines()[-1] == "different (largest relative difference 1.0e-09, in /state/energy)"
    )
