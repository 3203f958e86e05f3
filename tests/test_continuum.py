"""`ribbon verify --continuum`: the measures of stored states, orders over N, text, JSON, errors."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_support import QUICK_MOBIUS, QUICK_RING, ribbon, ribbon_json

from ribbon_cli import load_state, solve
from ribbon_cli.analysis import continuum_of, equilibrium_residuals, multiplier_curves
from ribbon_cli.analysis.continuum import BALANCE, ENERGY, LIMITS, MULTIPLIERS, SEAM
from ribbon_cli.errors import UsageError
from ribbon_cli.report.continuum import (
    Continuum,
    OrderRow,
    Quantity,
    order_tables,
    state_text,
    tables_text,
)
from ribbon_cli.store import encode

TABLES = {"run", "tables"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small ring and a small Moebius band."""
    folder = tmp_path_factory.mktemp("continuum")
    for text in (QUICK_RING, QUICK_MOBIUS):
        config = folder / "config.yaml"
        config.write_text(text, encoding="utf-8")
        solve(config, folder / "runs")
    return folder / "runs"


def measured(n: int, values: dict[str, float], *, limit: bool = False, floor: float = 0.0) -> Continuum:
    quantities = tuple(
        Quantity("section", name, "(1.1)", "all", value, floor, limit) for name, value in values.items()
    )
    return Continuum(n, 0.5, 2 * math.pi, 1, n, "thesis", True, (), quantities)


def row(*values: float, limit: bool = False, floor: float = 0.0, first: int = 50) -> OrderRow:
    states = [
        measured(first * 2**k, {"x": value}, limit=limit, floor=floor) for k, value in enumerate(values)
    ]
    (table,) = order_tables(reversed(states))
    return table.rows[0]


# --- orders ---


def test_orders_of_what_tends_to_zero() -> None:
    assert row(4.0, 1.0, 0.25).orders == (2.0, 2.0)
    assert row(1.0, 8.0).orders == (-3.0,)
    assert row(1.0, -0.25).orders == (None,)
    assert row(0.0, 0.0).orders == (None,)
    assert row(float("nan"), 1.0, 0.5).orders == (None, 1.0)
    assert row(float("nan"), 1.0).values == (None, 1.0)
    assert row(1.0).orders == ()


def test_orders_of_what_tends_to_a_limit() -> None:
    found = row(7.0, 4.0, 3.25, 3.0625, limit=True)
    assert found.orders == (2.0, 2.0)
    assert found.limit
    assert row(1.0, 2.0, 1.5, limit=True).orders == (None,)
    assert row(1.0, 2.0, limit=True).orders == ()


def test_values_made_of_the_solvers_tolerance_have_no_order() -> None:
    assert row(1.0, 0.25, 1e-9, floor=1e-8).orders == (2.0, None)


def test_grids_need_not_double() -> None:
    states = [measured(n, {"x": 1.0 / n**2}) for n in (50, 75, 100)]
    (table,) = order_tables(states)
    assert table.segments == (50, 75, 100)
    assert table.rows[0].orders == pytest.approx((2.0, 2.0))


def test_one_table_for_each_width() -> None:
    states = [measured(50, {"x": 1.0}), replace(measured(50, {"x": 2.0}), half_width=0.8)]
    tables = order_tables(states)
    assert [table.half_width for table in tables] == [0.5, 0.8]
    text = tables_text(tables)
    assert text.count("section") == 2
    assert "order" not in text


def test_a_quantity_that_one_grid_lacks() -> None:
    (table,) = order_tables([measured(50, {"x": 1.0}), measured(100, {"x": 0.5, "y": 1.0})])
    assert [found.values for found in table.rows] == [(1.0, 0.5), (None, 1.0)]
    assert "-" in tables_text([table])


# --- measures ---


def value(state: Continuum, section: str, name: str, zone: str) -> float:
    (found,) = [q for q in state.quantities if (q.section, q.name, q.zone) == (section, name, zone)]
    return found.value


def test_a_ring_is_measured_against_its_closed_form(runs: Path) -> None:
    found = continuum_of(load_state("ring@b=0.5,N=24", runs))
    assert found.inflections == ()
    assert {q.zone for q in found.quantities} == {"", "all", "largest", "as stored"}
    assert value(found, ENERGY, "Q of the surface", "") == pytest.approx(0.5 * math.pi, abs=1e-4)
    assert value(found, MULTIPLIERS, "lambda_2", "all") < 5e-3
    assert value(found, MULTIPLIERS, "gamma", "") < 1e-12
    assert value(found, LIMITS, "|lambda_2|", "largest") == pytest.approx(0.5, abs=5e-3)


def test_a_moebius_band_has_its_inflection_and_its_sigma(runs: Path) -> None:
    found = continuum_of(load_state("mobius@b=0.2,N=48", runs))
    assert len(found.inflections) == 1
    assert value(found, SEAM, "(1.66) without sigma", "moved away") > 0.1
    assert value(found, SEAM, "(1.66) as corrected", "moved away") < 1e-3
    far, everywhere = (value(found, BALANCE, "(1.62)", zone) for zone in ("far half", "all"))
    assert 0 < far <= everywhere


def test_curves_for_plots(runs: Path) -> None:
    curves = multiplier_curves(load_state("mobius@b=0.2,N=48", runs))
    assert [curve.name for curve in curves] == [f"lambda_{k}" for k in range(1, 6)]
    for curve in curves:
        for values in (curve.alpha, curve.computed, curve.theory, curve.distance, curve.far):
            assert values.shape == (48,)
        assert (np.diff(curve.alpha) > 0).all()
        assert np.abs(curve.computed - curve.theory)[curve.far].max() < 0.1 * np.abs(curve.computed).max()


def test_residuals_as_functions_of_arclength(runs: Path) -> None:
    record = load_state("mobius@b=0.2,N=48", runs)
    alpha = np.linspace(0.0, 2 * np.pi, 48 * 8, endpoint=False) + np.pi / 48 / 8
    found = equilibrium_residuals(record, alpha)
    assert found.force.shape == found.balance.shape == found.moment.shape == (384, 3)
    assert found.slope.shape == (384,)
    largest = value(continuum_of(record), BALANCE, "(1.62)", "all")
    assert np.linalg.norm(found.moment, axis=1).max() == pytest.approx(largest, rel=1e-12)
    eliminated = equilibrium_residuals(record, alpha, eliminate_xi=True)
    assert np.abs(eliminated.moment).max() > largest


def test_the_documents_configs_are_those_of_the_repository() -> None:
    root = Path(__file__).parent.parent
    configs = root / "configs" / "studies"
    page = (root / "docs" / "continuum.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```yaml\n# (\S+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert [name for name, _ in shown] == ["continuum-pi.yaml", "continuum-ring.yaml"]
    for name, text in shown:
        assert yaml.safe_load(text) == yaml.safe_load((configs / name).read_text(encoding="utf-8"))


def test_auxiliary_states_and_coarse_ones_are_refused(runs: Path) -> None:
    auxiliary = load_state("mobius:1", runs)
    for measure in (continuum_of, multiplier_curves, lambda r: equilibrium_residuals(r, np.zeros(1))):
        with pytest.raises(UsageError, match="auxiliary"):
            measure(auxiliary)
    state = load_state("ring@b=0.5,N=12", runs)
    assert continuum_of(state).segments == 12
    broken = replace(state, xi=np.full(12, np.nan))
    for measure in (continuum_of, multiplier_curves):
        with pytest.raises(UsageError, match="not finite"):
            measure(broken)
    with pytest.raises(UsageError, match="at least 12"):
        continuum_of(replace(state, segments=11))


def test_text_and_document_of_a_state(runs: Path) -> None:
    found = continuum_of(load_state("mobius@b=0.2,N=48", runs))
    text = state_text(found)
    assert text.startswith("b = 0.2, length 6.28319, one-sided, thesis, N = 48\ninflections at ")
    for name in ("(2.38)", "lambda_3 as stored", "xi eliminated", "moved away"):
        assert name in text
    assert "no inflections" in state_text(continuum_of(load_state("ring@b=0.5,N=24", runs)))
    void = replace(found, quantities=(Quantity("s", "x", "(1.1)", "all", float("nan")),))
    assert state_text(void).splitlines()[-1].split() == ["x", "(1.1)", "-"]


# --- the command ---


def test_a_runs_orders(runs: Path) -> None:
    document = ribbon_json("--runs", runs, "verify", "ring", "--continuum")
    assert set(document) == TABLES
    assert [table["half_width"] for table in document["tables"]] == [0.1, 0.5]
    (found,) = [r for r in document["tables"][1]["rows"] if r["name"] == "Q - Q_h"]
    assert found["orders"] == pytest.approx([2.0], abs=0.03)  # with 24 segments at most
    assert document["tables"][1]["segments"] == [12, 24]
    printed = ribbon("--runs", runs, "verify", "ring", "--continuum")
    assert printed.exit_code == 0
    assert "b = 0.5, length 6.28319, orientable, thesis" in printed.stdout
    assert not printed.stderr


def test_a_states_measures(runs: Path) -> None:
    document = ribbon_json("--runs", runs, "verify", "mobius@b=0.2,N=48", "--continuum")
    assert document["half_width"] == 0.2
    assert document["run"].startswith("mobius-")
    names = {q["name"] for q in document["quantities"]}
    assert {f"lambda_{k}" for k in range(1, 6)} | {"gamma", "Q - Q_h", "(1.62)"} <= names


def test_what_cannot_be_measured_is_a_usage_error(runs: Path) -> None:
    for ref, message in (
        ("mobius:1", "mobius:1: auxiliary"),
        ("ring:99", "no state 99"),
        ("rong", "did you mean ring"),
        ("all", "name one"),
    ):
        result = ribbon("--runs", runs, "verify", ref, "--continuum")
        assert result.exit_code == 2
        assert message in result.stderr
        assert not result.stdout


def test_states_without_certificate_are_named(tmp_path: Path) -> None:
    """They are measured all the same, and the exit code says so."""
    solve(
        {
            "name": "ring",
            "topology": {"half_twists": 0},
            "initial_guess": {"recipe": "cylinder", "segments": 16, "half_width": 0.3},
        },
        tmp_path,
    )
    record = replace(load_state("ring@N=16", tmp_path), certified=False)
    path = tmp_path / "state.h5"
    path.write_bytes(encode(record))
    result = ribbon("verify", path, "--continuum")
    assert result.exit_code == 3
    assert result.stderr == f"ribbon: {path}: no certificate\n"
    assert "(2.38)" in result.stdout


def test_documents_hold_plain_numbers(runs: Path) -> None:
    found = continuum_of(load_state("ring@b=0.5,N=24", runs))
    for item in asdict(order_tables([found])[0])["rows"]:
        assert all(type(v) in (float, type(None)) for v in item["values"])
