"""Numbers for people: significant digits whatever the size, in every medium."""

from __future__ import annotations

import doctest

import pytest
from store_support import make_summary

from ribbon_cli import digits
from ribbon_cli.cli.render import states_table, targets_table
from ribbon_cli.report.convergence import Entry, convergence_rows
from ribbon_cli.report.tables import RENDERERS
from ribbon_cli.study import Target

TINY = 8.949797385e-06


def test_the_examples_of_the_module():
    assert doctest.testmod(digits).failed == 0


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0.000000000"),
        (TINY, "8.94979739e-06"),
        (-TINY, "-8.94979739e-06"),
        (1.23456789012e-4, "0.000123456789"),
        (0.0631234567891, "0.0631234568"),
        (0.925620733, "0.925620733"),
        (41.433945453, "41.433945453"),
        (123456789.123456789, "123456789.123457"),
        (float("nan"), "nan"),
    ],
)
def test_an_energy_has_nine_digits_at_least(value, shown):
    assert digits.energy(value) == shown


@pytest.mark.parametrize("exponent", range(-30, 14))
def test_no_energy_loses_digits(exponent):
    value = 1.234567891234 * 10.0**exponent
    assert float(digits.energy(value)) == pytest.approx(value, rel=1e-8)


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (5.15166012, 1.23e-5, "5.151660 +- 1.2e-05"),
        (TINY, 1.23e-10, "8.94980e-06 +- 1.2e-10"),
        (TINY, 1.23e-3, "9e-06 +- 1.2e-03"),
        (TINY, None, "8.94979739e-06 (no error bar)"),
        (TINY, 0.0, "8.949797385e-06 +- 0"),
    ],
)
def test_an_error_bar_has_two_digits_and_the_value_ends_there(value, error, shown):
    assert digits.with_error(value, error) == shown


@pytest.fixture(scope="module")
def tiny_table():
    return convergence_rows(
        [Entry(1e-5, n, TINY * (1.0 - 1.0 / n**2), True) for n in (40, 80, 160, 320)], 6.283185307179586
    )


@pytest.mark.parametrize(
    ("form", "written"),
    [
        ("text", "8.94420376e-06"),
        ("markdown", "8.94420376e-06"),
        ("latex", r"$8.94420376 \times 10^{-6}$"),
        ("csv", repr(TINY * (1.0 - 1.0 / 40**2))),
        ("json", repr(TINY * (1.0 - 1.0 / 40**2))),
    ],
)
def test_tables_of_small_energies_keep_their_digits(tiny_table, form, written):
    text = RENDERERS[form](tiny_table)
    assert written in text
    assert "0.00000894" not in text
    assert "0.000008" not in text


def test_latex_has_no_exponent_of_programs(tiny_table):
    text = RENDERERS["latex"](tiny_table)
    assert "e-0" not in text
    assert r"\times 10^{-6}$" in text.partition(r"\end{tabular}")[2]  # in the sentences, too


def test_listings_of_small_energies_keep_their_digits():
    state = make_summary(half_width=1e-6, energy=TINY)
    assert "8.94979739e-06" in states_table([state], kinds=False)
    target = Target(1e-6, 40, 1, True, True, "")
    assert "8.94979739e-06" in targets_table([target], {1: state})
