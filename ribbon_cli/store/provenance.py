"""Which program made a state, where and when; any of these facts may be missing."""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import socket
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.doors import Later
from ribbon_cli.errors import StoreError
from ribbon_cli.store.folder import CONFIG, RESOLVED
from ribbon_cli.store.hdf5 import read_bytes
from ribbon_cli.store.log import utc_now

if TYPE_CHECKING:
    import platform
else:  # for writers alone
    platform = Later("platform")

Facts = dict[str, str | int | float]

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "BLIS_NUM_THREADS")
_GIT_SECONDS = 2.0
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def gather(argv: Sequence[str], config_folder: str | Path | None = None, **given: str | int | float) -> Facts:
    """Return the provenance of what this process makes, under the keys of layout.PROVENANCE.

    `config_folder` is where the config lies: its repository's revision is recorded if it has one. `given` are
    facts that only the caller knows (`wall_seconds`, `cpu_seconds`, `peak_memory_bytes`, `started`). What
    cannot be found is left out; nothing is raised. Everything but the start is found once a process. The
    program's own revision is recorded apart, where it runs from a working copy.
    """
    facts: Facts = {"argv": shlex.join(map(str, argv)), "started": utc_now()}
    facts |= _process_facts()
    facts |= {key.replace("git_", "code_"): value for key, value in _code().items()}
    if config_folder is not None:
        facts |= _git(os.path.abspath(config_folder))
    facts |= given
    return {key: _printable(value) if isinstance(value, str) else value for key, value in facts.items()}


@lru_cache(maxsize=1)
def _process_facts() -> Facts:
    """Facts that do not change within a process."""
    gatherers: tuple[Callable[[], Facts], ...] = (_machine, _versions, _hdf5, _blas, _threads)
    facts: Facts = {}
    for gatherer in gatherers:
        # A fact that cannot be had must never cost a result: any kind of failure just leaves it out.
        with suppress(Exception):
            facts |= gatherer()
    return facts


def config_facts(run: Path) -> Facts:
    """The config of a run's folder as written and as resolved, and the hash of the former; what cannot be
    read is left out.
    """
    facts: Facts = {}
    for name, key in ((CONFIG, "config_text"), (RESOLVED, "config_resolved")):
        with suppress(StoreError, ValueError):
            data = read_bytes(run / name)
            facts[key] = data.decode()
            if name == CONFIG:
                facts["config_sha256"] = hashlib.sha256(data).hexdigest()
    return facts


def _machine() -> Facts:
    """Machine and operating system."""
    return {"hostname": socket.gethostname(), "machine": platform.machine(), "platform": platform.platform()}


def _versions() -> Facts:
    """Versions of Python, of this package, and of all that it requires."""
    import importlib.metadata

    facts: Facts = {"version_python": platform.python_version()}
    required = importlib.metadata.requires("ribbon") or []
    names = [_NAME.match(line) for line in required if "extra ==" not in line]
    for package in ("ribbon", *(name[0] for name in names if name)):
        with suppress(importlib.metadata.PackageNotFoundError):
            key = re.sub(r"[^a-z0-9]+", "_", package.lower())
            facts[f"version_{key}"] = importlib.metadata.version(package)
    return facts


def _hdf5() -> Facts:
    """Version of the HDF5 library."""
    import h5py

    return {"version_hdf5": h5py.version.hdf5_version}


def _blas() -> Facts:
    """BLAS that NumPy was built with."""
    import numpy as np

    config: Any = np.show_config(mode="dicts")
    blas = config["Build Dependencies"]["blas"]
    return {"blas": f"{blas['name']} {blas['version']}"}


def _threads() -> Facts:
    """Threads that the environment allows BLAS, by the first variable that is set."""
    for name in _THREADS:
        if name in os.environ:
            return {"blas_threads": f"{name}={os.environ[name]}"}
    return {"blas_threads": "not set"}


@lru_cache(maxsize=1)
def _code() -> Facts:
    """Revision of the working copy that this program runs from, if its repository tracks it."""
    here = Path(__file__).resolve()
    # An environment inside someone's repository is not part of it.
    tracked = _run_git(str(here.parent), "ls-files", "--error-unmatch", here.name) is not None
    return _git(str(here.parent)) if tracked else {}


@lru_cache(maxsize=16)
def _git(folder: str) -> Facts:
    """Revision of the repository around a folder, if any, and whether tracked files differ from it."""
    lines = (_run_git(folder, "status", "--porcelain=v2", "--branch", "-uno") or "").splitlines()
    revisions = [line.split()[2] for line in lines if line.startswith("# branch.oid ")]
    if not revisions or revisions[0] == "(initial)":
        return {}
    return {"git_revision": revisions[0], "git_dirty": int(any(not line.startswith("#") for line in lines))}


def _run_git(folder: str, *words: str) -> str | None:
    """What git prints in a folder; None where it fails."""
    # The setting keeps a repository's own configuration from running a program of its choice. Inside a hook
    # the environment names the hook's repository, which need not be this one.
    try:
        done = subprocess.run(
            ["git", "-c", "core.fsmonitor=false", *words],
            cwd=folder,
            capture_output=True,
            timeout=_GIT_SECONDS,
            check=True,
            stdin=subprocess.DEVNULL,
            env=_environment_without_git() | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"},
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.decode(errors="replace")


def _environment_without_git() -> dict[str, str]:
    """The environment less what would point git elsewhere."""
    return {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}


def _printable(text: str) -> str:
    """Text that UTF-8 can hold and that has no null characters."""
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\0")
