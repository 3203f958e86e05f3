"""The benchmark runs: a few small solves by both contestants, and a document of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from references.curved import FoldedArc
from references.helix import whole_turns

from bench import run, strips
from bench.document import Part, page
from bench.machine import machine, versions
from bench.scaling_page import PICTURE

pytestmark = pytest.mark.peers


def test_a_quick_benchmark_writes_its_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "benchmarks.md"
    with np.errstate(all="warn", under="ignore", over="ignore", invalid="ignore", divide="ignore"):
        assert run.main(["--quick", "-o", str(path)]) == 0
    text = path.read_text(encoding="utf-8")
    assert text.count("\n## ") == 8
    assert text.count("\n<!-- part: ") == 5
    assert (tmp_path / PICTURE).stat().st_size > 10_000
    assert machine() in text
    assert versions() in text
    assert "missing" not in text
    assert "| 0.2 | 100 |" in text
    said = capsys.readouterr()
    assert said.out.count("\n") == 12
    assert "single solves" in said.err


def test_a_part_measured_alone_leaves_the_rest_of_the_page() -> None:
    one, other = (
        Part(name, [("a rule of old", True)], f"## {name}\n\nText.") for name in ("table", "strips")
    )
    both = page([one, other])
    again = page([Part("strips", [], "## Strips\n\nAnew.")], both)
    assert again.startswith(both[: both.index("<!-- part: strips")])
    assert "Anew." in again
    assert (both.count("a rule of old"), again.count("a rule of old")) == (2, 1)
    assert page([], again) == again
    assert page([], page([one])).count("## ") == 1


def test_the_machine_is_named_in_words() -> None:
    words = machine()
    assert "-core" in words
    assert words.endswith("Linux") or "," in words
    assert "casadi" in versions()


@pytest.mark.parametrize("rule", strips.RULES)
def test_the_peers_strip_has_the_force_that_is_the_slope_of_its_energy(rule: str) -> None:
    """Out of the plane, sheared and twisted: the multipliers of the end's place against differences."""
    peer = strips.build(12, rule)

    def clamps(share: float, moved: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> strips.Clamps:
        twist = 0.3 * share
        ruling = np.array([0.0, -np.sin(twist), np.cos(twist)])
        place = np.array([0.75, 0.0, 0.1 * share]) + moved
        return strips.Clamps(place, rulings=(np.array([0.0, 0.0, 1.0]), ruling))

    flat = peer.solve(strips.planar_start(12, 0.75), 0.05, clamps(0.0))
    here = peer.solve(flat, 0.05, clamps(1.0), flat.multipliers)
    assert (flat.status, here.status) == ("Solve_Succeeded", "Solve_Succeeded")
    for k in range(3):
        step = np.eye(3)[k] * 1e-4
        sides = [peer.solve(here, 0.05, clamps(1.0, tuple(s * step)), here.multipliers) for s in (-1, 1)]
        slope = (sides[1].energy - sides[0].energy) / 2e-4
        assert here.force[k] == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_the_peers_planar_strip_tends_to_the_elastica() -> None:
    """The energy at span 0.75 in elliptic functions, see docs/strips.md; errors fall by four."""
    exact = 0.05 * 10.551464017170
    energies = []
    for n in (16, 32):
        peer = strips.build(n)
        energies.append(
            peer.solve(strips.planar_start(n, 0.75), 0.05, strips.Clamps(np.array([0.75, 0, 0]))).energy
        )
    found = [abs(energy / exact - 1) for energy in energies]
    assert found[0] < 0.03
    assert found[0] / found[1] == pytest.approx(4, abs=0.3)


def test_the_peers_path_counts_its_solves() -> None:
    path = strips.shear_path(strips.build(10), strips.planar_start(10, 0.75), 0.75, 0.05, 0.06, 2)
    assert [state.success for state in path.states] == [True] * 3
    assert path.failures == []
    assert path.iterations == sum(state.iterations for state in path.states)
    assert path.states[0].energy < path.states[1].energy < path.states[2].energy


@pytest.mark.parametrize("rule", strips.RULES)
def test_the_peers_strip_between_clamps_on_a_helix_tends_to_it(rule: str) -> None:
    """Energy and force at order 2: the discrete clamps and the closed form hold each other."""
    helix = whole_turns(0.5, 0.05)
    ruling = helix.ruling(0.0)
    clamps = strips.Clamps(helix.point(1.0), rulings=(ruling, ruling))
    errors = []
    for n in (25, 50):
        u = np.array([helix.frame((i + 0.5) / n)[:, 0] for i in range(n)])
        start = strips.StripStart(u, np.tile(ruling, (n + 1, 1)), np.zeros(n))
        found = strips.build(n, rule).solve(start, 0.05, clamps)
        assert found.success
        errors.append([abs(found.energy - helix.energy), np.linalg.norm(found.force - helix.force)])
    assert np.array(errors[0]) / errors[1] == pytest.approx(4, abs=0.35)
    assert errors[1][0] < 0.002 * helix.energy
    assert errors[1][1] < 0.002 * np.linalg.norm(helix.force)


def test_the_folded_arc_is_an_equilibrium_of_the_peer() -> None:
    arc = FoldedArc(12, 0.15, 0.05)
    last = np.array([np.cos(arc.tilt), np.sin(arc.tilt), 0.0])
    clamps = strips.Clamps(np.array([arc.span, arc.lift, 0.0]), tangents=(np.array([1.0, 0.0, 0.0]), last))
    u = np.column_stack((np.cos(arc.angles), np.sin(arc.angles), np.zeros(12)))
    start = strips.StripStart(u, np.tile([0.0, 0.0, 1.0], (13, 1)), np.zeros(12))
    found = strips.build(12).solve(start, 0.05, clamps)
    assert found.success
    assert found.iterations <= 2
    assert found.energy == pytest.approx(arc.energy, rel=1e-12)
    assert found.u == pytest.approx(u, abs=1e-9)
    assert found.force == pytest.approx(0.0, abs=1e-9)
