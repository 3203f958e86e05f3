"""The convergence table: what it computes, when it extrapolates, and how it compares and prints."""

import csv
import io
import json
import math
import random
import subprocess
import sys
from dataclasses import replace

import pytest

from ribbon_cli.report.convergence import (
    Entry,
    convergence_rows,
)
from ribbon_cli.report.tables import (
    RENDERERS,
    Beside,
    as_csv,
    as_json,
    as_latex,
    as_markdown,
    as_text,
    with_error,
)

# Energies of the pi bands at N = 50, 100, ..., 3200 in both discretisations; the limits are those to which
# Richardson's values (orders 2, then 4) of N = 800, 1600, 3200 lead, at b = 0.1 alike in both to 1e-9.
THESIS_RULE = {
    0.1: [0.925620733, 0.9302222168, 0.9306315462, 0.9306559732, 0.9306494972, 0.9306464905, 0.9306456122],
    0.2: [1.8944530524, 1.8987059920, 1.8994289473, 1.8995525089, 1.8995770783, 1.8995826424, 1.8995839844],
    0.5: [5.1354731715, 5.1479122239, 5.1507510445, 5.1514326844, 5.1516006220, 5.1516424001, 5.1516528274],
    1.5: [
        39.1252714894,
        41.029553984,
        41.3576318681,
        41.4339454542,
        41.4528314047,
        41.4575418999,
        41.4587188474,
    ],
}
VALUE_AVERAGE = [
    0.9781860672,
    0.9308710402,
    0.9308290357,
    0.9307094632,
    0.9306632501,
    0.9306499564,
    0.9306464804,
]
LIMITS = {0.1: 0.930645308, 0.2: 1.899584427, 0.5: 5.151656302, 1.5: 41.45911110}

BESIDE = Beside(("seen_by_others",), (("0.04 [1]",),) * 16, ("100 % theirs",))


def entries(half_width, energies, start=50, certified=True):
    return [Entry(half_width, start * 2**k, e, certified, k + 1) for k, e in enumerate(energies)]


def extrapolation(half_width, energies, start=50):
    return convergence_rows(entries(half_width, energies, start)).extrapolations[0]


def series(f, start=400, levels=4):
    """f(h) on grids that resolve b = 1."""
    return [f(2 * math.pi / (start * 2**k)) for k in range(levels)]


@pytest.fixture
def table():
    return convergence_rows(e for b, values in THESIS_RULE.items() for e in entries(b, values[:4]))


def test_rows_give_difference_ratio_and_order():
    rows = convergence_rows(entries(1.0, [8.0, 4.0, 3.0])).rows
    assert [(r.delta, r.ratio, r.order) for r in rows] == [
        (4.0, 4.0, 2.0),
        (1.0, None, None),
        (None, None, None),
    ]
    assert [r.label for r in rows] == [1, 2, 3]


def test_rows_are_grouped_by_first_appearance_and_sorted_in_segments():
    table = convergence_rows(
        [Entry(0.5, 100, 2.0, True), Entry(0.2, 50, 1.0, True), Entry(0.5 * (1 + 1e-12), 50, 1.0, True)]
    )
    assert [(r.half_width, r.segments) for r in table.rows] == [(0.5, 50), (0.5, 100), (0.2, 50)]
    assert [item.half_width for item in table.extrapolations] == [0.5, 0.2]
    assert table.rows[0].delta == 1.0


def test_two_energies_for_one_place_are_refused():
    with pytest.raises(ValueError, match=r"b = 0.5, N = 50"):
        convergence_rows([Entry(0.5, 50, 1.0, True), Entry(0.5, 50, 2.0, True)])


@pytest.mark.parametrize("energy", [None, math.nan, math.inf])
def test_unknown_energies_are_missing(energy):
    rows = convergence_rows([Entry(0.5, 50, energy, False), Entry(0.5, 100, 2.0, True)]).rows
    assert (rows[0].energy, rows[0].delta) == (None, None)
    assert rows[0].note == "no certificate: E_50"


def test_a_difference_names_each_energy_without_certificate():
    rows = convergence_rows([Entry(0.5, 50, 1.0, True), Entry(0.5, 100, 2.0, False)]).rows
    assert rows[0].certified
    assert rows[0].note == rows[1].note == "no certificate: E_100"


def test_no_order_across_a_change_of_sign():
    # |ratio| = 3.77 would read as order 1.9
    row = convergence_rows(entries(0.1, THESIS_RULE[0.1])).rows[2]
    assert row.ratio == pytest.approx(3.77, abs=0.01)
    assert row.order is None
    assert "changes sign" in row.note


def test_equal_energies_give_no_ratio():
    rows = convergence_rows(entries(1.0, [2.0, 1.0, 1.0])).rows
    assert (rows[0].delta, rows[0].ratio, rows[0].order, rows[1].delta) == (1.0, None, None, 0.0)


def test_pure_second_order_is_extrapolated_exactly():
    item = extrapolation(1.0, series(lambda h: 3.0 - 0.7 * h**2), start=400)
    assert item.settled
    assert item.order == pytest.approx(2.0, abs=1e-6)
    assert abs(item.energy - 3.0) <= item.error <= 1e-10


def test_a_fourth_order_term_is_covered_with_safety():
    item = extrapolation(1.0, series(lambda h: 3.0 + 0.7 * h**2 + 40.0 * h**4), start=400)
    assert item.settled
    # A remainder of pure fourth order: the bar is 5 times the error, 15/3.
    assert abs(item.energy - 3.0) == pytest.approx(item.error / 5, rel=1e-3)


def test_three_levels_suffice_and_two_do_not():
    energies = series(lambda h: 3.0 + h**2, levels=3)
    assert extrapolation(1.0, energies, start=400).settled
    item = extrapolation(1.0, energies[1:], start=800)
    assert (item.settled, item.energy, item.error, item.order) == (False, energies[-1], None, None)
    assert item.reason == "an order needs certified energies at N = 3200 as well"
    alone = extrapolation(1.0, [3.0], start=333)
    assert alone.reason == "an order needs certified energies at N = 666 and 1332 as well"


def test_noise_is_not_taken_for_convergence():
    rng = random.Random(3)
    noisy = [[3.0 + rng.uniform(-1e-6, 1e-6) for _ in range(4)] for _ in range(500)]
    items = [extrapolation(1.0, energies, start=400) for energies in noisy]
    # Three random differences of one sign with a ratio near 4 are rare, but not impossible.
    assert sum(item.settled for item in items) <= 5
    barred = [item for item in items if item.error is not None]
    assert len(barred) > 0.6 * len(items)
    assert sum(abs(item.energy - 3.0) <= item.error for item in barred) > 0.75 * len(barred)


def test_differences_below_the_solvers_tolerance_are_settled():
    item = extrapolation(1.0, [3.0, 3.0 + 4e-13, 3.0 - 3e-13], start=400)
    assert (item.settled, item.order, item.energy) == (True, None, 3.0 - 3e-13)
    assert item.error == pytest.approx(3e-11)


def test_differences_that_do_not_fall_on_a_resolved_grid_have_no_error_bar():
    item = extrapolation(1.0, [1.0, 2.0, 3.5], start=400)
    assert (item.settled, item.error) == (False, None)


def test_slow_convergence_widens_the_bar_to_the_tail_it_implies():
    energies = [3.0 + 0.8**k for k in range(3)]
    item = extrapolation(1.0, energies, start=400)
    assert not item.settled
    assert abs(item.energy - 3.0) == pytest.approx(item.error)


def test_a_cancellation_does_not_shrink_the_bar():
    # c2 h^2 and c4 h^4 cancel in the last difference: 3 c2 h^2 + 15 c4 h^4 = 0 at the finest h.
    h = 2 * math.pi / 1600
    item = extrapolation(1.0, series(lambda s: 3.0 + s**2 - 0.2 * s**4 / h**2, levels=3), start=400)
    assert not item.settled
    assert abs(item.energy - 3.0) <= item.error


def test_fourth_order_alone_is_not_settled_but_covered():
    item = extrapolation(1.0, series(lambda h: 3.0 + h**4), start=400)
    assert not item.settled
    assert item.order == pytest.approx(4.0, abs=0.01)
    assert abs(item.energy - 3.0) <= item.error


def test_second_order_on_a_grid_that_does_not_resolve_the_layers_is_not_settled():
    item = extrapolation(0.1, series(lambda h: 3.0 + h**2, start=50, levels=3))
    assert not item.settled
    assert "h/b = 0.314 exceeds 0.04" in item.reason


def test_the_length_enters_through_h():
    bands = entries(1.0, series(lambda h: 3.0 + h**2, start=50, levels=3))
    assert not convergence_rows(bands, 100.0).extrapolations[0].settled
    assert convergence_rows(bands, 2 * math.pi).extrapolations[0].settled


def test_a_gap_in_the_doubling_ends_the_chain():
    energies = [Entry(1.0, n, 3.0 + 1.0 / n**2, True) for n in (100, 200, 800, 1600)]
    table = convergence_rows(energies)
    assert [r.delta is None for r in table.rows] == [False, True, False, True]
    item = table.extrapolations[0]
    assert (item.segments, item.settled, item.error) == (1600, False, None)


def test_energies_without_certificate_are_not_extrapolated():
    energies = [Entry(1.0, n, 3.0 + 1.0 / n**2, n < 3200) for n in (400, 800, 1600, 3200)]
    item = convergence_rows(energies).extrapolations[0]
    assert (item.segments, item.settled) == (1600, True)
    assert "without N = 3200, which has no certificate" in item.reason
    nothing = convergence_rows(entries(1.0, [1.0, 2.0], certified=False)).extrapolations[0]
    assert (nothing.energy, nothing.error, nothing.reason) == (None, None, "no energy has a certificate")


@pytest.mark.parametrize("levels", range(3, 8))
@pytest.mark.parametrize("half_width", THESIS_RULE)
def test_the_bar_covers_the_limit_of_every_pi_band_from_every_finest_grid(half_width, levels):
    item = extrapolation(half_width, THESIS_RULE[half_width][:levels])
    assert abs(item.energy - LIMITS[half_width]) <= item.error


@pytest.mark.parametrize("levels", range(3, 8))
def test_the_bar_covers_the_limit_in_the_other_discretisation(levels):
    item = extrapolation(0.1, VALUE_AVERAGE[:levels])
    assert abs(item.energy - LIMITS[0.1]) <= item.error


def test_the_order_of_the_narrow_band_settles_late():
    settled = [extrapolation(0.1, THESIS_RULE[0.1][:levels]).settled for levels in range(3, 8)]
    assert settled == [False, False, False, False, True]
    # The value at N = 3200 lies below E_400 although E_N rises to N = 400: the bar must reach downwards.
    item = extrapolation(0.1, THESIS_RULE[0.1][:4])
    assert item.energy == THESIS_RULE[0.1][3]
    assert 1e-5 < item.error < 5e-4


@pytest.fixture
def doubtful():
    """A group with an energy that has no certificate, and one that is unknown."""
    group = [
        Entry(0.5, 50, 5.1, True, 1),
        Entry(0.5, 100, 5.2, False, 2),
        Entry(0.5, 200, math.nan, False, 3),
    ]
    return convergence_rows(group)


@pytest.mark.parametrize("name", RENDERERS)
def test_every_format_marks_what_has_no_certificate(name, doubtful, table):
    assert RENDERERS[name](doubtful).count("no certificate") >= 3
    assert "no certificate" not in RENDERERS[name](table)


@pytest.mark.parametrize("name", RENDERERS)
def test_another_minimum_is_told_and_gives_no_order(name):
    why = "another minimum: taken back to N = 50 it has E = 0.9256, not 0.9722"
    group = entries(0.1, THESIS_RULE[0.1][:4])
    whole = convergence_rows(group)
    told = [replace(entry, breaks=why if entry.segments == 100 else "") for entry in group]
    broken = convergence_rows(told)
    assert [row.order is None for row in whole.rows] == [False, False, True, True]
    assert [row.order is None for row in broken.rows] == [True, False, True, True]
    assert broken.rows[0].delta == whole.rows[0].delta
    assert broken.rows[0].note == f"E_100 is not on the branch of E_50: {why}"
    assert "without N < 100, another minimum" in broken.extrapolations[0].reason
    assert "taken back to N" in RENDERERS[name](broken).replace("{", "").replace("}", "")


@pytest.mark.parametrize("name", RENDERERS)
def test_every_format_takes_an_empty_table(name):
    assert isinstance(RENDERERS[name](convergence_rows([])), str)


def test_text_is_aligned_and_plain(table):
    lines = as_text(table).split("\n\n")[0].splitlines()
    ends = {
        line.index(f"  {row.segments}  ")
        for line, row in zip(lines[1:], table.rows, strict=True)
        if row.segments == 100
    }
    assert len(ends) == 1
    assert len(lines) == 1 + len(table.rows)
    assert all(line == line.rstrip() and line.isascii() for line in lines)
    assert "order not settled, E_400 shown" in as_text(table)


@pytest.mark.parametrize("name", ["text", "markdown", "latex"])
def test_widths_are_written_so_that_references_find_them(name):
    """`@b=` matches to 1e-9, and a schedule of equal steps has widths of many digits."""
    page = RENDERERS[name](convergence_rows(entries(0.1 + 1.45 / 30, [3.0, 3.1])))
    assert page.count("0.1483333333") == 3


def test_markdown_rows_have_as_many_cells_as_the_head(doubtful, table):
    for page in (as_markdown(doubtful), as_markdown(table)):
        counts = {line.count("|") for line in page.splitlines() if line.startswith("|")}
        assert len(counts) == 1


def test_latex_is_balanced_and_escaped(doubtful, table):
    page = as_latex(table, BESIDE) + as_latex(doubtful)
    assert page.count(r"\begin{tabular}") == page.count(r"\end{tabular}") == 2
    assert page.count("$") % 2 == 0
    assert page.count("{") == page.count("}")
    assert r"$2.4427 \times 10^{-5}$" in page
    assert r"\textbf{no certificate: E\_100}" in page
    for block in page.split(r"\begin{tabular}")[1:]:
        body = block.split(r"\end{tabular}")[0].split("\n")[1:]
        columns = block[1 : block.index("}")]
        assert {line.count("&") + 1 for line in body if "&" in line} == {len(columns)}
    outside = "".join(page.split("$")[::2])
    assert "_" not in outside.replace(r"\_", "")


def test_latex_has_a_column_for_each_parameter_in_which_rows_differ():
    places = ((0.0, 0.1), (0.2, 0.1), (0.2, 0.3))
    entries = [
        Entry(0.02, n, 1.0 + x + y, True, others=(("shear", x), ("end_force_x", y)))
        for x, y in places
        for n in (40, 80)
    ]
    page = as_latex(convergence_rows(entries))
    heads, *lines = [line.removesuffix(r" \\").split(" & ") for line in page.splitlines() if " & " in line]
    assert heads[:4] == ["$b$", "shear", r"end\_force\_x", "$N$"]
    assert [line[:3] for line in lines[::2]] == [["$0.02$", f"${x:g}$", f"${y:g}$"] for x, y in places]
    assert {len(line) for line in lines} == {len(heads)}
    assert len(page.split("{")[2].split("}")[0]) == len(heads)
    assert "_" not in "".join(page.split("$")[::2]).replace(r"\_", "")


def test_csv_reads_back_to_full_precision(doubtful, table):
    rows = list(csv.DictReader(io.StringIO(as_csv(table))))
    assert [float(r["energy"]) for r in rows] == [r.energy for r in table.rows]
    assert rows[3]["delta"] == ""
    assert rows[3]["settled"] == "False"
    assert [r["certified"] for r in csv.DictReader(io.StringIO(as_csv(doubtful)))] == [
        "True",
        "False",
        "False",
    ]


def test_json_is_one_document_with_nulls(doubtful):
    document = json.loads(as_json(doubtful))
    row = document["rows"][2]
    keys = {"half_width", "segments", "energy", "delta", "ratio", "order", "certified", "label"}
    assert keys <= set(row)
    assert (row["energy"], row["delta"], row["certified"], row["label"]) == (None, None, False, 3)
    assert document["extrapolation"][0]["settled"] is False


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.9306559732, 3.07e-4, "0.93066 +- 3.1e-04"),
        (41.45938, 0.0025, "41.4594 +- 2.5e-03"),
        (3.0, 12.0, "3 +- 1.2e+01"),
        (3.0, None, "3.000000000 (no error bar)"),
        (0.0, 0.0, "0.0 +- 0"),
    ],
)
def test_a_value_is_shown_to_the_place_of_its_error(value, error, shown):
    assert with_error(value, error) == shown


def test_the_table_needs_no_heavy_import():
    code = "import ribbon_cli.report.tables, sys; print({'numpy', 'scipy', 'matplotlib'} & set(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "set()"


@pytest.mark.parametrize("render", [as_text, as_latex])
def test_further_columns_stand_before_the_notes(render, table):
    page = render(table, BESIDE)
    assert page.count("0.04") == 16 + render(table).count("0.04")
    assert page.rstrip().splitlines()[-1] in ("[1] 100 % theirs", r"[1] 100 \% theirs")
