"""Grids of many segments: chains of nodes, measured roundoff, and what refinement says where it ends.

Most tests lower the limits from which grids count as fine, so that coarse ones take the same paths.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dense_reference import dense_direction
from numeric_support import Array, assemble, load
from spectral_support import Place, pi_band
from test_saddle_free import problem_of

from ribbon_cli.config import parse_config
from ribbon_cli.model.band import Band, Discretisation, State
from ribbon_cli.model.folding import ClosureError, xi_between
from ribbon_cli.model.problem import Layout, Problem
from ribbon_cli.model.sparsity import Scatter, taken
from ribbon_cli.model.stencil import Seam
from ribbon_cli.model.term import Couplings
from ribbon_cli.solver import continuation, inertia, kkt, ldl, linear, newton, pencil, spectra, threads
from ribbon_cli.solver.continuation import to_segments
from ribbon_cli.solver.inertia import BlockReduction, count_below
from ribbon_cli.solver.kkt import FactorisationError, KKTMatrix
from ribbon_cli.solver.linear import Factor
from ribbon_cli.solver.newton import Options, solve
from ribbon_cli.solver.prolongation import Phase, smooth
from ribbon_cli.solver.status import Status
from ribbon_cli.study import memory, plan_of, refine_state, solve_config

THESIS = Discretisation.THESIS
SMALL = """
name: small
topology: {half_twists: 1}
initial_guess: {recipe: twist, segments: 20, half_width: 0.3, steps: 8}
spectrum: {modes: 0, full_up_to: 0}
"""


@pytest.fixture
def fine(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Grids of more than 60 segments count as fine, with chains of 16 nodes."""
    for module in (kkt, linear, newton):
        monkeypatch.setattr(module, "FINE", 60)
    monkeypatch.setattr(linear, "DELTA_GRID", 60)
    monkeypatch.setattr(inertia, "CHUNK", 16)
    kkt._kept_pattern.cache_clear()
    yield
    kkt._last_pattern.cache_clear()


def matrix_of(place: Place) -> KKTMatrix:
    return KKTMatrix(place.problem, place.local, place.problem.rotations(place.x))


def disturbed(name: str, amplitude: float = 0.02) -> KKTMatrix:
    problem, x, y = problem_of(name)
    rng = np.random.default_rng(3)
    x = problem.impose(x + amplitude * rng.standard_normal(problem.size))
    return assemble(problem, x, y)[2]


def twin(state: State, phase: Phase = Phase.NODE) -> Place:
    """The stationary band of the other grid phase, as the solver finds it."""
    problem = Problem(state.band)
    start = smooth(state, state.band.segments, phase).state
    return Place(problem, solve(problem, start.vector(), None, Options(leave_saddles=0)))


# --- chains of nodes ---


@pytest.mark.parametrize("chunk", [7, 16, 49])
@pytest.mark.parametrize("name", ["pi-b0.1-N50-saddle", "pi-b0.5-N50", "ring 51", "twist 50", "held 50"])
def test_chains_count_and_solve_as_the_whole_ring_does(
    name: str, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with a shift, with last chains of one and two nodes, and with held rulings anywhere."""
    matrix = disturbed(name)
    rhs = np.random.default_rng(5).standard_normal((matrix.size + matrix.border, 2))
    for shift in (0.0, -0.3, 2.0):
        whole = BlockReduction(matrix, shift)
        monkeypatch.setattr(inertia, "CHUNK", chunk)
        chains = BlockReduction(matrix, shift)
        assert (chains.negative, count_below(matrix, shift)) == (whole.negative, whole.negative)
        assert chains.inertia.trusted
        expected = whole.solve(rhs)
        np.testing.assert_allclose(chains.solve(rhs), expected, atol=1e-7 * np.abs(expected).max())
        monkeypatch.undo()


def test_blocks_of_a_part_are_those_of_the_whole() -> None:
    matrix = disturbed("pi-b0.5-N50")
    whole = matrix.blocks_between(0, 50)
    for first, last in ((0, 16), (16, 49), (49, 50)):
        for part, every in zip(matrix.blocks_between(first, last), whole, strict=True):
            np.testing.assert_array_equal(part, every[first:last])


@pytest.mark.parametrize("cores", [1, 2, 3])
def test_chains_give_the_same_bits_on_any_number_of_cores(
    cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrix = disturbed("pi-b0.5-N50")
    rhs = np.random.default_rng(6).standard_normal((matrix.size + matrix.border, 2))
    monkeypatch.setattr(inertia, "CHUNK", 7)
    monkeypatch.setattr(threads, "cores", lambda: cores)
    here = BlockReduction(matrix, 0.1)
    monkeypatch.setattr(threads, "cores", lambda: 1)
    alone = BlockReduction(matrix, 0.1)
    assert (here.negative, here.gap, here.inertia) == (alone.negative, alone.gap, alone.inertia)
    monkeypatch.setattr(threads, "cores", lambda: cores)
    np.testing.assert_array_equal(here.solve(rhs), alone.solve(rhs))


def test_threads_keep_order_and_floating_point_errors_and_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 3)
    with np.errstate(divide="ignore"):
        found = threads.mapped(lambda k: float(np.ones(1)[0] / np.float64(k)), range(50))
    assert found == [np.inf, *(1.0 / k for k in range(1, 50))]
    assert threading.active_count() == 1


def test_no_thread_works_where_one_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 3)
    monkeypatch.setattr(threads, "_most", 4)
    for most, others in ((1, False), (2, True)):
        threads.use(most)
        seen = threads.mapped(lambda _: threading.current_thread() is not threading.main_thread(), range(5))
        assert seen == [others] * 5


def test_threads_that_help_are_counted_in_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def work(_: int) -> None:
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass

    for count in (1, 3):
        monkeypatch.setattr(threads, "cores", lambda count=count: count)
        before = threads.cpu_seconds()
        threads.mapped(work, range(5))
        assert 0.1 <= threads.cpu_seconds() - before < 1.0


def test_memory_is_held_where_the_c_library_can(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, ...]] = []

    class Glibc:
        mallopt = staticmethod(lambda *values: asked.append(values))
        malloc_trim = mallopt

    monkeypatch.setattr(memory.ctypes, "CDLL", lambda _: Glibc)
    memory.hold_memory()
    assert asked == [(-4, 0), (-8, 1), (-1, -1)]
    memory.leave_grid(kkt.FINE)
    assert len(asked) == 3
    memory.leave_grid(kkt.FINE + 1)
    assert asked[3:] == [(0,)]
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda _: object())  # another C library
    memory.hold_memory()
    memory.leave_grid(kkt.FINE + 1)
    assert len(asked) == 4


@pytest.mark.usefixtures("fine")
def test_a_fine_grid_that_was_left_holds_no_factors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the last level went when it was stored."""
    monkeypatch.setattr(memory.kkt, "FINE", 60)
    outcome = solve_config(parse_config(SMALL + "refinement: [20, 40, 80]\n", "small.yaml"), tmp_path)
    assert [target.certified for target in outcome.targets] == [True, True, True]
    assert kkt._last_pattern.cache_info().currsize == 0


def test_what_a_thread_raises_is_raised_and_the_rest_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 2)
    begun = []

    def call(k: int) -> None:
        begun.append(k)
        if k == 1:
            raise FactorisationError("singular")
        time.sleep(0.01)

    with pytest.raises(FactorisationError, match="singular"):
        threads.mapped(call, range(500))
    assert len(begun) < 500


# --- products ---


def test_products_of_fine_grids_are_those_of_the_whole_matrix() -> None:
    """By the upper triangle, read twice; of the gauge and of held rulings as well."""
    for name in ("pi-b0.5-N50", "held 50"):
        matrix = disturbed(name)
        size = matrix.size
        whole = matrix.whole.toarray()
        for shape in ((), (3,)):
            v = np.random.default_rng(7).standard_normal((size + matrix.border, *shape))
            expected = whole @ v
            found = matrix._product_by_halves(v)
            np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("count", [0, 3, 1000])
def test_places_in_four_bytes_are_taken_part_by_part(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ribbon_cli.model.sparsity.PART", 64)
    rng = np.random.default_rng(8)
    values, places = rng.standard_normal(30), rng.integers(0, 30, count)
    for kind in (np.int32, np.int64):
        np.testing.assert_array_equal(taken(values, places.astype(kind)), values[places])


# --- roundoff ---


def test_a_count_at_an_eigenvalue_is_not_trusted() -> None:
    """Roundoff decides there; a millionth of it to either side does not."""
    problem, x, y = problem_of("pi-b0.5-N50")
    local, rotations, matrix = assemble(problem, x, y)
    values = dense_direction(problem, local, rotations)[2]
    for k in (0, 3, 40):
        value, off = float(values[k]), 1e-6 * float(values[k])
        counts = [inertia.inertia(matrix, shift) for shift in (value - off, value + off)]
        assert [count.negative for count in counts] == [k, k + 1]
        assert all(count.trusted for count in counts)
    low, high = (float(values[3]) * (1.0 + off) for off in (-1e-6, 1e-6))
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = inertia.inertia(matrix, middle)
        if not found.trusted:
            break
        low, high = (middle, high) if found.negative <= 3 else (low, middle)
    assert not found.trusted
    assert high - low < 1e-10


def test_a_count_does_not_hold_at_another_place() -> None:
    """Measured against the saddle half a facet further, the minimum's count says nothing, nor the pivots."""
    minimum, saddle = pi_band(50, THESIS), pi_band(50, THESIS, Phase.NODE)
    here, there = matrix_of(minimum), matrix_of(saddle)
    assert inertia.inertia(here).trusted
    assert not inertia.inertia(here, like=there).trusted
    assert Factor(here).proves_minimum()
    assert not Factor(here).proves_minimum(there)


def test_products_in_extended_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = disturbed("ring 12")
    monkeypatch.setattr(kkt, "ROWS_AT_ONCE", 50)
    v = np.random.default_rng(1).standard_normal(matrix.size + matrix.border)
    exact = np.array([sum(map(np.longdouble, row), np.longdouble(0)) for row in matrix.whole.toarray() * 0])
    for j, column in enumerate(matrix.whole.toarray().T):
        exact += column.astype(np.longdouble) * np.longdouble(v[j])
    found = matrix.extended_product(v)
    assert found.dtype == np.longdouble
    scale = float(np.abs(exact).max())
    assert float(np.abs(found - exact).max()) <= 50 * float(np.finfo(np.longdouble).eps) * scale


@pytest.mark.usefixtures("fine")
def test_exact_factors_solve_where_regularised_ones_do_not() -> None:
    """A tenth of a millionth from an eigenvalue the block reduction is refined to the last digits."""
    place = pi_band(100, THESIS)
    matrix = matrix_of(place)
    rhs = np.random.default_rng(2).standard_normal(matrix.size + matrix.border)
    exact, usual = Factor(matrix, exact=True), Factor(matrix)
    assert exact.surplus == 0
    one, other = exact.solve(rhs), usual.solve(rhs)
    for solution in (one, other):
        rest = matrix.scale * rhs - matrix.product(solution / matrix.scale)
        assert np.abs(rest).max() <= 1e-7 * np.abs(matrix.scale * rhs).max()
    np.testing.assert_allclose(exact.solve_roughly(rhs), one, atol=1e-6 * np.abs(one).max())


# --- the same band by the paths of fine grids ---


@pytest.mark.usefixtures("fine")
def test_a_band_by_the_paths_of_fine_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    state = pi_band(50, THESIS).result.state
    found = to_segments(state, 100, Options())
    place = Place(Problem(found.band), found.result)
    other = twin(found.result.state)
    monkeypatch.undo()
    usual = to_segments(state, 100, Options())
    assert (found.result.status, found.result.negative) == (Status.MINIMUM, 0)
    assert found.result.energy == pytest.approx(usual.result.energy, rel=1e-13)
    assert (other.result.status, other.result.negative) == (Status.SADDLE, 1)
    assert other.result.energy > found.result.energy
    for at in (place, other):
        values = dense_direction(at.problem, at.local, at.problem.rotations(at.x))[2]
        assert int((values < 0).sum()) == at.result.negative


@pytest.mark.usefixtures("fine")
def test_a_saddle_is_left_by_the_paths_of_fine_grids() -> None:
    state = pi_band(100, THESIS).result.state
    problem = Problem(state.band)
    start = smooth(state, 100, Phase.NODE).state
    found = solve(problem, start.vector())
    assert found.certified
    assert [met.index for met in found.saddles] == [1]


@pytest.mark.usefixtures("fine")
def test_a_level_takes_one_exact_reduction_and_one_symbolic_factorisation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where the judgement takes a step; each serves the points after the one that it was made for."""
    state = pi_band(100, THESIS).result.state
    monkeypatch.setattr(newton, "SETTLED", 1e-9)
    made = {"reductions": 0, "symbolic": 0, "judged": 0}

    def counting(name: str, what: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **more: Any) -> Any:
            made[name] += 1
            return what(*args, **more)

        return counted

    monkeypatch.setattr(linear, "BlockReduction", counting("reductions", linear.BlockReduction))
    monkeypatch.setattr(ldl.qdldl, "Solver", counting("symbolic", ldl.qdldl.Solver))
    monkeypatch.setattr(newton._Solve, "_judge_fine", counting("judged", newton._Solve._judge_fine))
    found = to_segments(state, 200, replace(Options(), tolerance=1e-6)).result
    assert found.certified
    assert made["judged"] > 1
    assert (made["reductions"], made["symbolic"]) == (1, 1)


@pytest.mark.usefixtures("fine")
def test_exact_factors_of_another_place_are_made_anew_where_they_are_too_far() -> None:
    """A saddle half a facet off has other solutions and another count."""
    minimum, saddle = matrix_of(pi_band(100, THESIS)), matrix_of(pi_band(100, THESIS, Phase.NODE))
    rhs = np.random.default_rng(2).standard_normal(minimum.size + minimum.border)
    factor = Factor(saddle, exact=True)
    assert not factor.serving(minimum).counted().trusted
    assert factor.stale
    np.testing.assert_allclose(
        factor.solve(rhs), Factor(minimum, exact=True).solve(rhs), rtol=1e-6, atol=1e-9
    )
    assert not factor.stale
    assert (factor.counted().negative, factor.counted().trusted) == (0, True)


def test_spectra_by_the_paths_of_fine_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns in parts and counts without regularised factors find the same modes."""
    place = pi_band(100, THESIS)
    found = []
    for fine in (3200, 60):
        monkeypatch.setattr(pencil, "FINE", fine)
        if fine == 60:
            monkeypatch.setattr(pencil, "Factor", None)
        metrics = ("euclidean", "physical")
        found.append(spectra.lowest_spectra(place.problem, place.x, place.local, metrics, 8))
    for one, other in zip(*found, strict=True):
        assert one.labels == other.labels
        assert (np.abs(one.values - other.values) <= one.bounds + other.bounds).all()
        assert one.vectors.shape == other.vectors.shape


# --- starts ---


def test_rulings_may_nearly_meet_on_fine_grids() -> None:
    """How nearly is a matter of roundoff, which grows with the number of segments."""

    def nearly(segments: int, gap: float) -> Array:
        band = Band(segments, 0.5)
        u, g = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
        following = g + (1.0 - gap) * (band.h / 0.5) * u
        return xi_between(band, u, g, following)

    assert nearly(100, 1e-12)[0] == pytest.approx(0.5 * np.log(2e12), rel=1e-3)
    assert nearly(100_000, 1e-10)[0] == pytest.approx(0.5 * np.log(2e10), rel=1e-2)
    with pytest.raises(ClosureError, match="rulings meet"):
        nearly(100, 1e-15)
    with pytest.raises(ClosureError, match="rulings meet"):
        nearly(100_000, 1e-12)


def test_patterns_sum_what_shares_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    rows, columns, values = rng.integers(0, 30, 500), rng.integers(0, 20, 500), rng.standard_normal(500)
    expected = np.zeros((30, 20))
    np.add.at(expected, (rows, columns), values)
    usual = Scatter.build(rows, columns, (30, 20))
    monkeypatch.setattr("ribbon_cli.model.sparsity.COMPACT_FROM", 100)
    compact = Scatter.build(rows, columns, (30, 20))
    assert (usual.slot.dtype, compact.slot.dtype) == (np.int64, np.int32)
    for scatter in (usual, compact):
        np.testing.assert_allclose(scatter.matrix(values).toarray(), expected, atol=1e-14)
        assert scatter.matrix(values).has_sorted_indices


@pytest.mark.parametrize("couplings", [(), (("U0", "U0"), ("U", "U"))], ids=["bare", "coupled"])
@pytest.mark.parametrize("seam", list(Seam))
def test_stretched_patterns_are_those_sorted(
    seam: Seam, couplings: Couplings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kkt, "DIRECTLY", kkt.TEMPLATE + 1)
    for segments, rotations, compact in ((22, 3, 1 << 20), (57, 0, 100), (120, 1, 1 << 20)):
        monkeypatch.setattr("ribbon_cli.model.sparsity.COMPACT_FROM", compact)
        monkeypatch.setattr(kkt, "COMPACT_FROM", compact)
        layout = Layout(segments, seam, couplings)
        found = kkt._built_pattern(layout, rotations)
        usual = kkt.pattern_of(kkt._upper(layout, rotations))
        for one, other in zip(arrays_of(found), arrays_of(usual), strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)


def arrays_of(pattern: kkt.Pattern) -> list[Array]:
    """Everything that a pattern is."""
    upper, whole = pattern.upper, pattern.whole_matrix
    empty = pattern.upper_matrix
    arrays = [upper.indptr, upper.indices, upper.slot, empty.indptr, empty.indices, pattern.diagonal]
    return [*arrays, whole.indptr, whole.indices, pattern.whole_source]


# --- refinement ---


def failing_starts(monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    def fails(*_: object) -> None:
        raise ClosureError(why)

    monkeypatch.setattr(continuation, "smooth", fails)


def test_facets_are_not_split_on_fine_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    state, _ = load("pi-b0.5-N50")
    failing_starts(monkeypatch, "no start")
    assert to_segments(state, 100, replace(Options(), max_steps=2)).method == "facets split in two"
    monkeypatch.setattr(continuation, "LONG_WAYS_UP_TO", 60)
    with pytest.raises(ClosureError, match="no start"):
        to_segments(state, 100, Options())


def test_refinement_says_in_a_line_why_a_level_has_no_certificate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No roundoff is small enough: what was measured is told, and no finer level is tried."""
    first = solve_config(parse_config(SMALL, "small.yaml"), tmp_path)
    monkeypatch.setattr(inertia, "CONTRACTION", 0.0)
    monkeypatch.setattr(linear, "CONTRACTION", 0.0)
    monkeypatch.setattr(continuation, "LONG_WAYS_UP_TO", 20)
    outcome = refine_state(tmp_path, f"{first.run.name}:{first.targets[0].label}", levels=2)
    assert outcome.exit_code == 3
    (level, next_one) = outcome.targets
    assert (level.reached, level.certified, next_one.reached) == (True, False, False)
    assert "Roundoff may change the count: measured " in level.message
    assert next_one.message.startswith("not reached: state ")
    assert "refined to N = 40: not certified: Converged, but whether it is a minimum" in next_one.message
    assert "\n" not in next_one.message
    assert outcome.new_states == 1


def test_plans_tell_what_large_levels_take() -> None:
    text = SMALL + "refinement: [20, 40]\n"
    assert not any("memory" in note for note in plan_of(parse_config(text, "small.yaml"), None).notes)
    levels = ", ".join(str(50 * 2**k) for k in range(12))
    large = SMALL.replace("segments: 20", "segments: 50") + f"refinement: [{levels}]\n"
    notes = [note for note in plan_of(parse_config(large, "small.yaml"), None).notes if "memory" in note]
    assert [note.split(":")[0] for note in notes] == [f"N = {50 * 2**k}" for k in range(7, 12)]
    assert notes[-1].endswith("and 3.5 GiB of memory each")


@pytest.mark.large
@pytest.mark.parametrize("segments", [400, 800])
@pytest.mark.parametrize("phase", list(Phase))
def test_counts_are_those_of_dense_algebra(segments: int, phase: Phase, fine: None) -> None:
    place = pi_band(segments, THESIS, phase)
    values = dense_negative(place)
    found = inertia.inertia(matrix_of(place))
    assert found.trusted
    assert found.negative == place.result.negative == values == (1 if phase is Phase.NODE else 0)


def dense_negative(place: Place) -> int:
    """Negative eigenvalues by dense algebra at any N."""
    from ribbon_cli.solver.saddle_free import dense_negative_eigenpairs

    return dense_negative_eigenpairs(place.problem, place.local, matrix_of(place))[0].size


@pytest.mark.large
@pytest.mark.parametrize(
    ("half_width", "limit"), [(0.5, 5.15165630), (0.1, None)], ids=["b = 0.5", "b = 0.1"]
)
def test_refined_to_a_hundred_thousand_segments(half_width: float, limit: float | None) -> None:
    """Every level has its certificate; energies converge with the square of h; twins are saddles."""
    state, multipliers = load(f"pi-b{half_width:g}-N50")
    state = solve(Problem(state.band), state.vector(), multipliers.vector()).state
    energies: list[float] = []
    for k in range(1, 12):
        found = to_segments(state, 50 * 2**k, Options()).result
        assert found.certified, (found.state.band.segments, found.message)
        state = found.state
        energies.append(found.energy)
        if state.band.segments == 51200:
            other = twin(state)
            assert (other.result.status, other.result.negative) == (Status.SADDLE, 1)
    ends = [(4.0 * fine - coarse) / 3.0 for coarse, fine in pairwise(energies)]
    assert ends[-1] == pytest.approx(ends[-2], rel=1e-10)
    if limit is not None:
        assert ends[-1] == pytest.approx(limit, abs=1e-8)
