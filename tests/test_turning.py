"""Whether a branch turns back, by the states stored on the way; what is said where steps lead elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from store_support import make_record, make_run, make_spectrum

from ribbon_cli.solver.status import Status
from ribbon_cli.store import Summary
from ribbon_cli.study.failure import Failure, fold_facts
from ribbon_cli.study.journal import Journal
from ribbon_cli.study.progress import silence
from ribbon_cli.study.turning import soft_in_checkerboards, turns_back

FOLD = 0.5
WIDTHS = (0.4, 0.48, 0.495)
FAILED = 0.503
"""Where the shortest step from the last of the widths failed."""


def journal_of(root: Path, rate: float, root_part: float) -> Journal:
    """A run with states at these widths, in which one part changes evenly and one as before the fold."""
    run = make_run(root)
    still, way = make_record(1), np.random.default_rng(5).normal(size=make_record(1).u.shape)
    with run.writing():
        for label, b in enumerate(WIDTHS, start=1):
            u = still.u + (rate * b + root_part * np.sqrt(FOLD - b)) * way
            run.commit(make_record(label, half_width=b, u=u, g=still.g, stage=f"b = {b}"))
    return Journal(run, silence, (), {})


def last_of(journal: Journal) -> Summary:
    return journal.run.look_up(len(WIDTHS))


@pytest.mark.parametrize(
    ("rate", "root_part", "folds"),
    [(0.0, 1.0, True), (1.0, -3.0, True), (1.0, 0.0, False), (0.0, 0.0, False)],
)
def test_a_fold_is_told_by_what_steps_change(
    tmp_path: Path, rate: float, root_part: float, folds: bool
) -> None:
    journal = journal_of(tmp_path, rate, root_part)
    assert turns_back(journal, last_of(journal), "half_width", FAILED) is folds


def test_a_fold_far_ahead_of_where_steps_fail_is_none(tmp_path: Path) -> None:
    journal = journal_of(tmp_path, 0.0, 1.0)
    assert not turns_back(journal, last_of(journal), "half_width", WIDTHS[-1] + 1e-4)


def test_one_step_tells_of_no_fold(tmp_path: Path) -> None:
    journal = journal_of(tmp_path, 0.0, 1.0)
    assert not turns_back(journal, journal.run.look_up(2), "half_width", FAILED)


@pytest.mark.parametrize("label", ["checkerboard", "mode"])
def test_the_softest_mode_is_that_of_the_nearest_state_with_a_spectrum(tmp_path: Path, label: str) -> None:
    run = make_run(tmp_path)
    spectrum = make_spectrum(np.random.default_rng(1), 10, "physical")
    labels = ("rotation", "sliding", label, *["mode"] * len(spectrum.labels))[: len(spectrum.labels)]
    known = make_record(1, spectra=(type(spectrum)(**vars(spectrum) | {"labels": labels}),))
    with run.writing():
        run.commit(known)
        run.commit(make_record(2, half_width=0.6, spectra=()))
    journal = Journal(run, silence, (), {})
    assert soft_in_checkerboards(journal, journal.run.look_up(2)) is (label == "checkerboard")


def test_the_sentence_claims_no_fold() -> None:
    current = Summary.of(make_record(2))
    for soft in (False, True):
        facts = fold_facts("band", current, "half_width", 0.5, 0.9, 0.6, soft)
        said = Failure("other-branch", Status.LEFT_BRANCH, "", facts).sentence
        way = "every step from b = 0.5 towards b = 0.9 leads to another branch"
        assert said.startswith(f"{way}, and nothing stored tells of a fold: ")
        assert "`ribbon continue band:2 --to 0.9 --arclength`" in said
        assert ("`discretisation: value-average`" in said) is soft
