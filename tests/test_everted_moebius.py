"""Everted Moebius bands: saddles with Lk = 1/2 and three inflections, and configs that keep a saddle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.survey import climbed, random_band
from ribbon_cli.config import ConfigError, dump_resolved, load_config, parse_config
from ribbon_cli.model.band import Band, State
from ribbon_cli.model.folding import from_state
from ribbon_cli.model.problem import Problem
from ribbon_cli.model.symmetry import find_symmetries
from ribbon_cli.model.topology import linking_number
from ribbon_cli.recipes.cylinder import cylinder
from ribbon_cli.solver.arclength import nearest, point_of
from ribbon_cli.solver.singular import lowest_mode
from ribbon_cli.solver.status import Status
from ribbon_cli.study import Outcome, solve_config
from ribbon_cli.study.records import state_of
from ribbon_cli.study.status import standing

CONFIGS = Path(__file__).parents[1] / "configs" / "studies"
CONFIG = """
name: everted-moebius
topology: {{half_twists: 1}}
initial_guess: {{state: {state}{saddle}}}
{widths}
spectrum: {{modes: 0, full_up_to: 0}}
"""


def start(family: str, segments: int) -> Path:
    return CONFIGS / "data" / f"everted-moebius-N{segments}-{family}.npz"


def load(path: Path) -> State:
    with np.load(path) as data:
        band = Band(data["xi"].size, float(data["half_width"]), sigma=int(data["sigma"]))
        return State(band, data["u"], data["g"], data["xi"])


def inflections(state: State) -> int:
    """Sign changes of the fold angle along the closed strip."""
    side = np.sign(from_state(state).theta)
    return int((side != np.append(side[1:], state.band.sigma * side[0])).sum())


def kept(state: Path) -> str:
    """A config that follows a short branch from a state, as the saddle it is."""
    return CONFIG.format(state=state, saddle=", saddle: keep", widths="widths: {arclength: {to: 0.105}}")


def solved(root: Path, text: str) -> Outcome:
    return solve_config(parse_config(text, "everted-moebius.yaml"), root)


# --- the bands ---


@pytest.mark.parametrize(
    ("family", "index", "energies", "lowest"),
    [
        ("A", 1, (2.038690781, 2.042564913, 2.042863925), (-0.10654, -0.10826, -0.11013)),
        ("B", 2, (2.214126737, 2.219569465, 2.219607397), (-0.22010, -0.22034, -0.22107)),
    ],
)
def test_stationary_on_every_mesh_and_of_one_index(
    family: str, index: int, energies: tuple[float, ...], lowest: tuple[float, ...]
) -> None:
    """b = 0.1: energy and lowest eigenvalue settle as N doubles; no sliding mode, no contact, C2."""
    for segments, energy, value in zip((80, 160, 320), energies, lowest, strict=True):
        found = nearest(load(start(family, segments)))
        assert (found.status, found.negative) == (Status.SADDLE, index)
        assert found.energy == pytest.approx(energy, abs=1e-9)
        assert max(found.kkt_residual, found.constraint_residual) < 1e-11
        state = found.state
        lk = linking_number(state.u, state.g, state.band.sigma, state.band.h).linking_number
        assert lk == pytest.approx(0.5, abs=1e-9)
        assert inflections(state) == 3
        point = point_of(state, found.multipliers)
        assert not point.contact
        mode = lowest_mode(point)
        assert mode is not None
        assert mode[0] == pytest.approx(value, abs=1e-5)
        assert mode[1] < 0.2
        assert find_symmetries(state).name == "C2"


def test_left_to_itself_it_falls_to_the_pi_band(tmp_path: Path) -> None:
    """Without `saddle: keep` the saddle is met, stored and left; what is below it is the usual band."""
    outcome = solved(tmp_path, CONFIG.format(state=start("A", 80), saddle="", widths="widths: [0.1]"))
    assert outcome.exit_code == 0
    met, fallen = outcome.run.states(all=True)
    assert (met.kind, met.negative_eigenvalues) == ("saddle", 1)
    assert met.energy == pytest.approx(2.038690781, abs=1e-9)
    assert fallen.certified
    assert fallen.energy == pytest.approx(0.929785977, abs=1e-9)
    assert inflections(state_of(outcome.run.load(fallen.label))) == 1


# --- keeping a saddle ---


def test_a_branch_begins_at_a_kept_saddle(tmp_path: Path) -> None:
    text = kept(start("A", 80))
    outcome = solved(tmp_path, text)
    assert outcome.exit_code == 0
    (target,) = outcome.targets
    assert (target.reached, target.certified, target.kept) == (True, False, True)
    (course,) = outcome.branches
    assert course.reason == "range"
    first, last = outcome.run.states()
    assert [first.half_width, last.half_width] == [0.1, 0.105]
    assert [first.status, last.status] == ["saddle", "saddle"]
    assert [first.linking_number, last.linking_number] == pytest.approx([0.5, 0.5])
    assert first.energy == pytest.approx(2.038690781, abs=1e-9)
    assert first.kind == "equilibrium"
    again = solved(tmp_path, text)
    assert (again.new_states, again.exit_code, again.targets) == (0, 0, outcome.targets)
    assert load_config(outcome.run.path / "resolved.yaml").guess.keep_saddle
    assert standing(outcome.run).status == "complete"


def test_other_rule_other_saddle(tmp_path: Path) -> None:
    """From the thesis's state Newton goes onto that of the value average, next to it."""
    text = kept(start("B", 160)) + "discretisation: value-average\n"
    outcome = solved(tmp_path, text)
    assert outcome.exit_code == 0
    first = outcome.run.states()[0]
    assert (first.status, first.discretisation) == ("saddle", "value-average")
    assert first.energy == pytest.approx(2.2195694650, rel=2e-3)
    assert abs(first.energy - 2.2195694650) > 1e-6


def test_where_no_stationary_point_is_near(tmp_path: Path) -> None:
    state = load(start("A", 80))
    bent = np.roll(state.xi, 7)
    np.savez(tmp_path / "bent.npz", u=state.u, g=state.g, xi=bent, half_width=0.1, sigma=-1)
    outcome = solved(tmp_path / "runs", kept(tmp_path / "bent.npz"))
    assert outcome.exit_code == 3
    assert outcome.run.states() == []
    assert "No stationary point is next to the state: Newton's method" in " ".join(outcome.notes)
    assert outcome.failures


def test_a_minimum_may_be_kept_too() -> None:
    found = nearest(cylinder(Band(24, 0.3)))
    assert (found.status, found.negative, found.certified) == (Status.MINIMUM, 0, True)


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        (
            "{state: a.npz, saddle: keep}",
            "m.yaml:2:16: initial_guess.saddle: keep goes with a branch, widths: {arclength: {to: ...}}: "
            "other schedules go from minimum to minimum",
        ),
        (
            "{state: a.npz, saddle: kept}",
            "m.yaml:2:39: initial_guess.saddle: must be leave or keep, got kept, did you mean keep?",
        ),
        (
            "{recipe: twist, segments: 50, half_width: 0.1, saddle: keep}",
            "m.yaml:2:63: initial_guess.saddle: goes with a state, {state: ..., saddle: keep}: the "
            "result of a recipe is not kept as one",
        ),
    ],
)
def test_what_saddle_goes_with(guess: str, message: str) -> None:
    text = f"topology: {{half_twists: 1}}\ninitial_guess: {guess}\n"
    with pytest.raises(ConfigError) as error:
        parse_config(text, "m.yaml")
    assert str(error.value) == message


def test_to_leave_is_the_default_and_changes_no_name() -> None:
    """A config that says so is the config that does not; one that keeps is another."""
    text = "name: a\ntopology: {half_twists: 1}\ninitial_guess: {state: a.npz}\n" + (
        "widths: {arclength: {to: 0.2}}\n"
    )
    plain, leaving, keeping = (
        parse_config(text.replace("a.npz", word), "a.yaml")
        for word in ("a.npz", "a.npz, saddle: leave", "a.npz, saddle: keep")
    )
    assert plain.hash8() == leaving.hash8() != keeping.hash8()
    assert parse_config(dump_resolved(keeping), "b.yaml").guess.keep_saddle


# --- the survey ---


def test_the_survey_climbs_to_a_saddle_of_the_index_asked_for() -> None:
    """From a point beside family A at N = 80 a climb along one mode leads back to it."""
    found = nearest(load(start("A", 80)))
    rng = np.random.default_rng(1)
    problem = Problem(found.state.band)
    moved = found.x + 1e-4 * rng.normal(size=found.x.size)
    end = climbed(problem, moved, 1)
    assert not isinstance(end, str)
    assert (end.index, end.inflections) == (1, 3)
    assert end.energy == pytest.approx(found.energy, abs=1e-9)


def test_random_bands_have_one_half_twist() -> None:
    rng, band = np.random.default_rng(5), Band(30, 0.2, sigma=-1)
    made = [state for state in (random_band(band, rng) for _ in range(30)) if state is not None]
    assert made
    for state in made:
        assert linking_number(state.u, state.g, -1, band.h).linking_number == pytest.approx(0.5)
        assert np.abs(Problem(band).constraints(state.vector())).max() < 1e-9
