"""`python -m bench.same [COMMIT]`: the working tree against a commit; exit code 1 if anything differs."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

from filelock import FileLock

from . import report, speed
from .builds import PACKAGE, Build, commit_build, folder_build, libraries, resolved
from .cases import CASES, ROOT, Case, CaseError, read_cases
from .differences import compare
from .expect import read_expected, split
from .observe import Observation, kept, observe

CACHE = ROOT / "build" / "same"
_START_UPS = 21


def main(argv: Sequence[str] | None = None) -> int:
    """Run, compare, print; 0 all equal, 1 something differs, 2 the question or a case is wrong."""
    asked = _arguments().parse_args(argv)
    try:
        with FileLock(_made(asked.cache) / "lock"):
            return _compare(asked)
    except CaseError as error:
        print(f"same: {error}", file=sys.stderr)
        return 2


def _arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.same", description=__doc__)
    parser.add_argument(
        "commit",
        nargs="?",
        help=f"a commit, or a folder with {PACKAGE}/; default: where the branch main was left",
    )
    parser.add_argument("--quick", action="store_true", help="the quick cases and the start-up alone")
    parser.add_argument("--case", action="append", default=[], help="this case only; may be repeated")
    parser.add_argument(
        "--expect", action="append", type=Path, default=[], help="a file of expected differences"
    )
    parser.add_argument("--all", action="store_true", help="print every difference, not one of each kind")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="cases at a time")
    parser.add_argument("--no-speed", action="store_true", help="measure no times")
    parser.add_argument("--at-most", type=float, metavar="RATIO", help="fail if a time's ratio is above this")
    parser.add_argument("--cases", type=Path, default=CASES, help="another list of cases")
    parser.add_argument(
        "--cache", type=Path, default=CACHE, help="where builds and results of commits are kept"
    )
    return parser


def _compare(asked: argparse.Namespace) -> int:
    """Do what was asked."""
    cases = _chosen(read_cases(asked.cases), asked)
    expected = tuple(item for path in asked.expect for item in read_expected(path))
    folders = _reference(asked), asked.cache / "present"
    builds = folders[0][0], folder_build(ROOT, folders[1])
    cases = _known_to(builds[0], cases)
    pairs = _observed(cases, builds, (folders[0][1], folders[1]), asked.jobs)
    broken = _broken(cases, [before for before, _ in pairs])
    with ProcessPoolExecutor(asked.jobs) as pool:
        compared = list(pool.map(compare, [case.name for case in cases], *zip(*pairs, strict=True)))
    left, covered = split((d for item in compared for d in item.differences), expected)
    print(f"{builds[1].name} against {builds[0].name}")
    _print(report.counts(compared, left))
    _print(report.details(left, asked.all))
    _print(report.expectations(expected, covered))
    if broken:
        _print(["", f"{builds[0].name} does not do what the cases say, which then show nothing:", *broken])
    paces = [] if asked.no_speed else _paces(builds, asked.quick)
    _print(report.paces(paces))
    slow = [pace.what for pace in paces if asked.at_most is not None and pace.ratio > asked.at_most]
    for what in slow:
        print(f"{what}: takes more than {asked.at_most:g} times as long")
    if left:
        print(f"\nthe files: {folders[0][1]} and {folders[1]}")
    return 2 if broken else int(bool(left or slow))


def _chosen(cases: Sequence[Case], asked: argparse.Namespace) -> list[Case]:
    """The cases that are asked for. Raises CaseError."""
    known = [case.name for case in cases]
    for name in asked.case:
        if name not in known:
            raise CaseError(f"{name!r} is no case; known are {', '.join(known)}")
    return [
        case for case in cases if (case.name in asked.case if asked.case else case.quick or not asked.quick)
    ]


def _known_to(build: Build, cases: Sequence[Case]) -> list[Case]:
    """The cases of what a build has; the others are named."""
    for case in cases:
        if not (build.tree / case.needs).exists():
            print(f"{case.name}: left out, {build.name} has no {case.needs}", flush=True)
    return [case for case in cases if (build.tree / case.needs).exists()]


def _reference(asked: argparse.Namespace) -> tuple[Build, Path]:
    """The build to compare with, and its folder in the cache."""
    if asked.commit and (Path(asked.commit) / PACKAGE).is_dir():
        folder = asked.cache / "folder"
        return folder_build(Path(asked.commit).resolve(), folder), folder
    commit = resolved(asked.commit)
    folder = asked.cache / commit[:16]
    return commit_build(commit, folder), folder


def _observed(
    cases: Sequence[Case], builds: tuple[Build, Build], folders: tuple[Path, Path], jobs: int
) -> list[tuple[Observation, Observation]]:
    """Every case by both builds; those of a commit are taken from the cache, where they are there."""
    shutil.rmtree(folders[1] / "cases", ignore_errors=True)
    with ThreadPoolExecutor(jobs) as pool:
        # In the order of the list, the long ones first in it.
        tasks = [
            [pool.submit(_one, case, build, folder) for build, folder in zip(builds, folders, strict=True)]
            for case in cases
        ]
        try:
            return [(before.result(), after.result()) for before, after in tasks]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _one(case: Case, build: Build, folder: Path) -> Observation:
    """One case by one build."""
    name = f"{case.name}-{case.key(libraries())}" if build.commit else case.name
    place = folder / "cases" / name
    there = kept(place) if build.commit else None
    if there is not None:
        return there
    done = observe(case, build, place)
    print(f"{case.name}, {build.name}: {done.seconds:.0f} s of processor", file=sys.stderr, flush=True)
    return done


def _broken(cases: Sequence[Case], observations: Sequence[Observation]) -> list[str]:
    """Steps that do not end as the case says, by the build that is compared with: they show nothing."""
    return [
        f"  {case.name}: {step.text}: {printed.code}, not {step.code}: {printed.stderr.strip()[-200:]}"
        for case, observation in zip(cases, observations, strict=True)
        for step, printed in zip(case.steps, observation.steps, strict=True)
        if printed.code != step.code
    ]


def _paces(builds: tuple[Build, Build], quick: bool) -> list[speed.Pace]:
    """Seconds of both builds; what cannot be measured is told."""
    print("measuring start-up and the store", file=sys.stderr, flush=True)
    paces = [speed.start_up(builds, _START_UPS)]
    if not quick:
        try:
            paces += speed.store(builds)
        except subprocess.CalledProcessError as error:
            last = error.stderr.decode(errors="replace").strip().splitlines()[-1:]
            print(f"the run of {speed.STATES} states was not measured: {' '.join(last)}")
    return paces


def _print(lines: Iterable[str]) -> None:
    """Print lines."""
    for line in lines:
        print(line)


def _made(folder: Path) -> Path:
    """A folder that is there."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder


if __name__ == "__main__":
    sys.exit(main())
