"""Folds and branch points of planar strips, N -> infinity, against the references that are shot and in
elliptic functions."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import strip_points as ours
from references.planar import buckled
from references.singular import Critical, branch_point_in_span, fold_in_tilt

ACCURACY = 1e-5


def same(found: ours.Limit, exact: Critical, place: float) -> None:
    """Parameter, energy and force to 1e-5, which the extrapolation's own estimate of its error promises."""
    assert found.value[0] == pytest.approx(place, abs=ACCURACY)
    assert found.value[1:4] == pytest.approx([exact.energy, *exact.force], rel=ACCURACY)
    assert found.error[:4].max() < ACCURACY
    assert found.orders[:, 0] == pytest.approx(2.0, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize(("lift", "guess"), [(0.0, (7.9, -65.0, 8.9, 0.89)), (0.3, (7.0, -68.4, -19.4, 1.2))])
def test_the_folds_in_the_tilt_tend_to_the_exact_ones(
    lift: float, guess: tuple, figure: Callable[[str], None]
) -> None:
    found = ours.limit(lambda n: ours.fold_in_tilt(n, lift).point)
    figure(f"tilt, energy, force x, y, moment: {found}")
    exact = fold_in_tilt(0.75, lift, guess)
    same(found, exact, exact.tilt)
    assert found.value[4] == pytest.approx(exact.moment, rel=ACCURACY)


@pytest.mark.long
@pytest.mark.parametrize("along", [ours.branch_point_in_span, ours.vertex_in_span])
def test_the_branch_point_in_the_span_tends_to_the_exact_one_along_both_branches(
    along: Callable, figure: Callable[[str], None]
) -> None:
    found = ours.limit(lambda n: along(n).point)
    figure(f"span, energy, force x, y, moment: {found}")
    exact = branch_point_in_span(0.3)
    same(found, exact, exact.span)
    assert found.value[4] == pytest.approx(0.0, abs=ACCURACY)


@pytest.mark.long
def test_the_branch_point_of_the_figure_eight_tends_to_span_zero(figure: Callable[[str], None]) -> None:
    found = ours.limit(lambda n: ours.branch_point_of_the_eight(n).point)
    figure(f"span, energy, force x, y, moment: {found}")
    eight = buckled(0.0, 1.0)
    assert found.value[0] == pytest.approx(0.0, abs=ACCURACY)
    assert found.value[[1, 2, 4]] == pytest.approx(
        [eight.energy, eight.force[0], eight.moment[2]], rel=ACCURACY
    )
    # The span's error is of third order; that of all else is of second.
    assert found.orders[:, 0] == pytest.approx(3.0, abs=0.05)
