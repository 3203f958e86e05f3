"""Table 3.1 as published beside energies that are known: agreement to the printed digits, and notes."""

import csv
import io

import pytest
from test_convergence_table import THESIS_RULE, entries, table  # noqa: F401

from paper.table import ReferenceDelta, agrees_as_printed, compare_with_thesis, texts, thesis_table
from ribbon_cli.report.convergence import Entry, convergence_rows

SECOND_MINIMUM = Entry(0.1, 50, 0.9721610151, certified=True)


def test_table_3_1_is_reproduced_to_the_printed_digits(table):  # noqa: F811
    compared = [c for c in compare_with_thesis(table, thesis_table()) if c.delta is not None]
    assert len(compared) == 12
    assert [(c.half_width, c.segments) for c in compared if not c.agrees] == [(0.1, 50)]
    assert all(abs(c.relative_difference) < 1e-5 for c in compared if c.agrees)


def test_the_second_minimum_explains_the_odd_number_by_its_figures(table):  # noqa: F811
    row = compare_with_thesis(table, thesis_table(), SECOND_MINIMUM)[0]
    assert row.delta == pytest.approx(0.00460148, abs=5e-9)
    assert (row.thesis, row.agrees) == ("0.0419388", False)
    assert "E'_50 = 0.972161015" in row.footnote
    assert "|E'_50 - E_100| = 0.0419388 is the printed number" in row.footnote
    assert "E_50 = 0.925620733" in row.footnote
    assert all(not c.footnote for c in compare_with_thesis(table, thesis_table(), SECOND_MINIMUM)[1:])


def test_a_second_minimum_that_explains_nothing_is_not_said_to():
    bands = convergence_rows(entries(0.1, THESIS_RULE[0.1][:2]))
    other = Entry(0.1, 50, 0.960610, certified=False)
    note = compare_with_thesis(bands, thesis_table(), other)[0].footnote
    assert "state (without certificate)" in note
    assert "not the printed number either" in note
    alone = convergence_rows(entries(0.1, THESIS_RULE[0.1][:1]))
    assert "E_100 is not known" in compare_with_thesis(alone, thesis_table(), other)[0].footnote


def test_a_published_number_without_ours_stays_open():
    compared = compare_with_thesis(convergence_rows([]), [ReferenceDelta(0.3, 50, "0.1")])
    assert (compared[0].delta, compared[0].agrees, compared[0].relative_difference) == (None, None, None)


@pytest.mark.parametrize(
    ("value", "printed", "agrees"),
    [
        (0.000681640049, "0.00068164", True),
        (0.000681645001, "0.00068164", False),
        (2.44270e-5, "2.4427e-5", True),
        (2.44276e-5, "2.4427e-5", False),
        (1.904284, "1.90428", True),
        (1.9043, "1.90428", False),
        (9.9999996, "10.0000", True),
    ],
)
def test_agreement_respects_the_printed_digits(value, printed, agrees):
    assert agrees_as_printed(value, printed) is agrees


def test_the_reference_table_is_complete():
    reference = thesis_table()
    assert len(reference) == 18
    assert reference[0] == ReferenceDelta(0.1, 50, "0.0419388")
    assert {r.half_width for r in reference} == {0.1, 0.2, 0.5, 0.8, 1.0, 1.5}


def test_every_format_shows_published_numbers_and_footnotes(table):  # noqa: F811
    made = texts(table, compare_with_thesis(table, thesis_table(), SECOND_MINIMUM))
    assert set(made) == {"txt", "tex", "csv"}
    for page in made.values():
        assert "0.0419388" in page
        assert "another discrete minimum" in page


def test_csv_carries_the_published_number_as_a_number(table):  # noqa: F811
    made = texts(table, compare_with_thesis(table, thesis_table(), SECOND_MINIMUM))
    rows = list(csv.DictReader(io.StringIO(made["csv"])))
    assert float(rows[0]["thesis_delta"]) == 0.0419388
    assert rows[0]["agrees"] == "False"
    assert rows[3]["thesis_delta"] == ""
    assert sum(bool(row["footnote"]) for row in rows) == 1
