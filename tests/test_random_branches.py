"""Branches at random: whatever a method comes by, the command ends in order and certifies nothing false.

`make test-branches` follows 300, in parts so that all cores share them; `make test` a few.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import ribbon
from dense_reference import DenseModel

from ribbon_cli.store import list_runs
from ribbon_cli.study.records import multipliers_of, state_of
from ribbon_cli.verify.recompute import problem_of

SEED = 1910
PARTS, PART = 30, 10
QUICK = (3, 77, 238)
"""Branches that `make test` follows."""
SOFT = 1e-7
"""Euclidean eigenvalue whose sign dense algebra does not tell."""
RECIPES = ("cylinder", "twist", "schoenke", "eversion", "state")
SECOND_MINIMUM = Path(__file__).parent / "data" / "pi-b0.1-N50-second-minimum.npz"


def drawn(k: int) -> tuple[str, list[str]]:
    """The config and the options of `continue` of branch k, each from its own generator."""
    rng = np.random.default_rng([SEED, k])
    recipe = RECIPES[k % len(RECIPES)]
    twists = {
        "cylinder": 0,
        "twist": int(rng.choice([-1, 1])),
        "schoenke": int(rng.choice([-1, 1]) * rng.integers(3, 6)),
        "eversion": 0,
        "state": 1,
    }[recipe]
    segments = int(rng.integers(8 * abs(twists) if recipe == "schoenke" else 12, 49))
    segments += segments % 2 if recipe == "eversion" else 0
    width = float(rng.uniform(0.05, {"schoenke": 0.3, "eversion": 0.15}.get(recipe, 0.6)))
    guess = f"recipe: {recipe}, segments: {segments}, half_width: {width!r}"
    guess += {"twist": ", steps: 12", "eversion": ", steps: 12"}.get(recipe, "")
    if recipe == "state":
        guess = f"state: {SECOND_MINIMUM}"
    config = f"""\
name: drawn
topology: {{half_twists: {twists}}}
discretisation: {rng.choice(["thesis", "value-average"])}
initial_guess: {{{guess}}}
spectrum: {{modes: 0, full_up_to: 0}}
"""
    to, other = np.sort(rng.uniform(0.01, 2.0, 2))[:: int(rng.choice([-1, 1]))]
    options = ["--to", repr(float(to)), "--arclength", "--steps", str(rng.integers(3, 25))]
    options += ["--max-step", f"{10 ** rng.uniform(np.log10(0.02), 1.0):.6g}"]
    options += ["--switch", "1"] if rng.random() < 0.3 else []
    options += ["--back-to", repr(float(other)), "--both"] if rng.random() < 0.3 else []
    options += ["--at", repr(float(rng.uniform(*sorted((to, width)))))] if rng.random() < 0.3 else []
    options += (
        ["--stop-at", str(rng.choice(["fold", "stability-lost", "contact"]))] if rng.random() < 0.3 else []
    )
    return config, options


def follow(k: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Solve the start and follow its branch; the document of `continue` where there is one."""
    config, options = drawn(k)
    path = folder / f"{k}.yaml"
    path.write_text(config)
    runs = folder / f"runs-{k}"
    result = ribbon("-q", "--runs", runs, "solve", path)
    assert result.exit_code in (0, 3), (k, result.output, config)
    (run,) = list_runs(runs)
    if not run.states():
        return
    label = run.states()[0].label
    result = ribbon("-q", "--runs", runs, "continue", f"drawn:{label}", *options, "--json")
    line = " ".join(options)
    assert result.exit_code in (0, 2, 3), (k, result.output, config, line)
    if result.exit_code == 2:  # a start that is no stationary point, say
        assert result.stderr.count("\n") == 1, (k, result.stderr)
        return
    document = json.loads(result.stdout)
    assert (result.exit_code == 3) == any(
        branch["reason"] == "step-too-small" for branch in document["branches"]
    ), (k, line)
    yield document
    again = ribbon("-q", "--runs", runs, "show", "drawn", "--json")
    assert "interrupted" not in again.stdout, (k, line)


def false_certificates(runs: Path) -> list[str]:
    """States whose certificate, or index, the dense count refuses, with the eigenvalues that say so."""
    found = []
    (run,) = list_runs(runs)
    for state in run.states(all=True):
        if state.negative_eigenvalues is None:
            continue
        record = run.load(state.label)
        problem = problem_of(record)  # a saddle met on the way to a guess has its rulings held as well
        x = state_of(record).vector()
        local = problem.local_derivatives(x, multipliers_of(record))
        values = DenseModel(problem, local, problem.rotations(x)).values
        clear = values[np.abs(values) > SOFT]
        least, most = int((clear < 0.0).sum()), int((clear < 0.0).sum() + values.size - clear.size)
        if not least <= record.negative_eigenvalues <= most:
            found.append(f"{record.label}: {record.negative_eigenvalues}, dense {values[:4]}")
    return found


def followed(numbers: Iterator[int] | range | tuple[int, ...], folder: Path) -> Counter[str]:
    """How many branches ended for which reason."""
    reasons: Counter[str] = Counter()
    for k in numbers:
        documents = list(follow(k, folder))
        reasons += Counter(branch["reason"] for document in documents for branch in document["branches"])
        reasons["no start"] += not documents
        assert false_certificates(folder / f"runs-{k}") == [], drawn(k)
    return +reasons


@pytest.mark.long
def test_a_few_branches_at_random(tmp_path: Path) -> None:
    assert followed(QUICK, tmp_path).total() >= len(QUICK)


@pytest.mark.branches
@pytest.mark.parametrize("part", range(PARTS))
def test_branches_at_random(part: int, tmp_path: Path, figure: Callable[[str], None]) -> None:
    reasons = followed(range(part * PART, (part + 1) * PART), tmp_path)
    figure(", ".join(f"{word} {count}" for word, count in reasons.most_common()))
