"""How complete a survey is: what the numbers of hits say of equilibria that were not met.

Equilibria are the species of ecology, and ends of ways from random starts the individuals. The estimates
are lower bounds where some equilibria are much rarer than others: of those that are met with next to no
chance nothing is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

RARE = 10
"""Most hits of what counts as rare, after Chao & Lee (1992)."""


@dataclass(frozen=True)
class Estimate:
    """What so many hits on so many equilibria say.

    `once` and `twice` count the equilibria with one and with two hits. `coverage` is the chance that the next
    hit is on a known one (Good 1953). `chao1` and `ace` estimate the number of all equilibria; the latter is
    None where every rare one was hit once.
    """

    hits: int
    found: int
    once: int
    twice: int
    coverage: float
    chao1: float
    ace: float | None


def estimate(counts: Sequence[int]) -> Estimate | None:
    """The estimates from the hits on each equilibrium that was met; None without any."""
    counts = [count for count in counts if count]
    if not counts:
        return None
    hits, once, twice = sum(counts), counts.count(1), counts.count(2)
    # Chao (1984), Scand. J. Statist. 11, 265, in the form without bias, which needs no twice: Chao (2005).
    chao1 = len(counts) + (hits - 1) / hits * once * (once - 1) / (2 * (twice + 1))
    return Estimate(hits, len(counts), once, twice, 1.0 - once / hits, chao1, _ace(counts))


def _ace(counts: Sequence[int]) -> float | None:
    """The abundance-based coverage estimator of Chao & Lee (1992), J. Am. Stat. Assoc. 87, 210, with rare
    and common ones apart."""
    rare = [count for count in counts if count <= RARE]
    common, once, size = len(counts) - len(rare), rare.count(1), sum(rare)
    if not rare:
        return float(common)
    if once == size:
        return None
    coverage = 1.0 - once / size
    pairs = sum(count * (count - 1) for count in rare)
    spread = max(len(rare) / coverage * pairs / (size * max(size - 1, 1)) - 1.0, 0.0)
    return common + len(rare) / coverage + once / coverage * spread


def accumulation(counts: Sequence[int], points: int = 60) -> list[tuple[int, float]]:
    """Expected number of equilibria in n of the hits, drawn without order: Hurlbert (1971), Ecology 52, 577.

    At most so many pairs (n, number), n ascending to all hits.
    """
    total = sum(counts)
    step = max(1, -(-total // points))
    places = sorted({*range(1, total + 1, step), total}) if total else []
    return [(n, sum(1.0 - _missed(total, count, n) for count in counts)) for n in places]


def _missed(total: int, count: int, n: int) -> float:
    """Chance that n of all hits are none of an equilibrium's: C(total - count, n) / C(total, n)."""
    if n > total - count:
        return 0.0
    logs = (
        math.lgamma(total - count + 1)
        - math.lgamma(total - count - n + 1)
        - math.lgamma(total + 1)
        + math.lgamma(total - n + 1)
    )
    return math.exp(logs)
