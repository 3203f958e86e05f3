"""Builds: the package of a commit, of another folder and of the working tree, each in a folder of its own."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import gettempdir

from .cases import ROOT, CaseError

PACKAGE = "ribbon_cli"
# `bench` has the maker of the run of 5000 states.
PARTS = (PACKAGE, "bench")
_LIBRARIES = (
    "numpy",
    "scipy",
    "h5py",
    "qdldl",
    "click",
    "pyyaml",
    "matplotlib",
    "pillow",
    "rich",
    "filelock",
)
_UNWANTED = ("RIBBON_", "PYTHON", "GIT_", "COV_", "COVERAGE", "PYTEST", "COLUMNS", "LINES")


@dataclass(frozen=True)
class Build:
    """A tree with the package in it; `name` is for people, `commit` where it is one, and can be kept."""

    name: str
    tree: Path
    commit: str | None = None

    def command(self, *words: str) -> list[str]:
        """A command line of its program, whatever lies in the folder where it is run."""
        return [sys.executable, "-P", "-m", PACKAGE, *words]

    def environment(self) -> dict[str, str]:
        """An environment in which its program is the one that runs."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith(_UNWANTED)}
        return kept | {"PYTHONPATH": str(self.tree), "NO_COLOR": "1", "LC_ALL": "C.UTF-8", "TZ": "UTC"}


def resolved(commit: str | None, root: Path = ROOT) -> str:
    """The commit's full name; of None, the commit at which the branch `main` was left. Raises CaseError."""
    if commit is not None:
        found = _git(root, "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}")
        if found is None:
            raise CaseError(f"{commit!r} is no commit of {root}, nor a folder with {PACKAGE}/ in it")
        return found
    for branch in ("main", "origin/main"):
        found = _git(root, "merge-base", "HEAD", branch)
        if found is not None:
            return found
    raise CaseError(
        "there is no branch main to compare with: name a commit, as in `make same-as COMMIT=v0.1.0`"
    )


def commit_build(commit: str, folder: Path, root: Path = ROOT) -> Build:
    """The build of a commit below `folder`, made there unless it is there already."""
    tree = folder / "tree"
    build = Build(commit[:10], tree, commit)
    if not tree.exists():
        parts = [part for part in PARTS if _git(root, "cat-file", "-e", f"{commit}:{part}") is not None]
        archive = subprocess.run(
            ["git", "archive", "--format=tar", commit, *parts], cwd=root, capture_output=True, check=True
        )
        fresh = _emptied(folder / "tree.new")
        # The module tarfile has its filters, without which it warns, from 3.11.4 on.
        subprocess.run(["tar", "-x", "-C", fresh], input=archive.stdout, check=True)
        _compile(fresh)
        fresh.rename(tree)
    _check(build)
    return build


def folder_build(source: Path, folder: Path) -> Build:
    """A copy of what a folder has now, below `folder`: it may be edited while the comparison runs."""
    tree = _emptied(folder / "tree")
    for part in PARTS:
        if (source / part).is_dir():
            shutil.copytree(source / part, tree / part)
    _compile(tree)
    build = Build("the working tree" if source == ROOT else str(source), tree)
    _check(build)
    return build


def libraries() -> str:
    """What results depend on but for the program: interpreter, machine, libraries, lengths of names."""
    versions = (f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES)
    return " ".join((sys.version, platform.machine(), platform.platform(), *versions, f"{len(gettempdir())}"))


def _check(build: Build) -> None:
    """Raise CaseError unless it is this build's package that runs."""
    code = f"import {PACKAGE}; print({PACKAGE}.__file__)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=build.environment(),
        cwd=build.tree,
        capture_output=True,
        check=False,
    )
    where = Path(done.stdout.decode().strip() or ".")
    if done.returncode or not where.is_relative_to(build.tree):
        raise CaseError(f"{build.tree}: {PACKAGE} is imported from {where}: {done.stderr.decode()[-300:]}")


def _compile(tree: Path) -> None:
    """Compile a tree, as an installation does: commands start sooner."""
    subprocess.run([sys.executable, "-m", "compileall", "-q", PACKAGE], cwd=tree, check=True)


def _emptied(folder: Path) -> Path:
    """A folder with nothing in it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _git(root: Path, *words: str) -> str | None:
    """What git prints; None where it fails."""
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, check=False)
    return done.stdout.decode().strip() if done.returncode == 0 else None
