"""Provenance: facts that are there, and nothing raised for those that are not."""

from __future__ import annotations

import platform
import resource
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from store_support import make_record

from ribbon_cli.store import decode, encode, gather, write_atomic
from ribbon_cli.store import provenance as module
from ribbon_cli.study.clock import Clock


@pytest.fixture(autouse=True)
def _forget(monkeypatch):
    module._process_facts.cache_clear()
    module._git.cache_clear()
    module._code.cache_clear()
    yield
    module._process_facts.cache_clear()
    module._git.cache_clear()
    module._code.cache_clear()


def test_facts_of_this_process(monkeypatch, tmp_path):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    facts = gather(["ribbon", "solve", "my config.yaml"], wall_seconds=1.5, peak_memory_bytes=10)
    assert facts["argv"] == "ribbon solve 'my config.yaml'"
    assert facts["version_python"] == platform.python_version()
    assert facts["version_numpy"] == np.__version__
    assert facts["blas_threads"] == "OPENBLAS_NUM_THREADS=1"
    assert {"version_h5py", "version_hdf5", "blas", "hostname", "machine", "platform"} <= facts.keys()
    assert facts["started"].endswith("Z")
    assert (facts["wall_seconds"], facts["peak_memory_bytes"]) == (1.5, 10)
    assert "git_revision" not in facts
    write_atomic(tmp_path / "x.h5", encode(make_record(provenance=facts)))
    assert decode(tmp_path / "x.h5").provenance == facts


def test_given_facts_win():
    assert gather([], started="then")["started"] == "then"


def test_a_gatherer_that_fails_costs_only_its_own_facts(monkeypatch):
    def fail(*args, **kwargs):
        raise RuntimeError("no")

    monkeypatch.setattr(np, "show_config", fail)
    monkeypatch.setattr("socket.gethostname", fail)
    facts = gather(["ribbon"])
    assert "blas" not in facts
    assert "hostname" not in facts
    assert "version_python" in facts


def test_texts_that_utf8_cannot_hold_are_escaped():
    assert gather(["ribbon", "a\udcffb\0"])["argv"] == "ribbon 'a\\udcffb\\0'"


def git(folder, *arguments: str) -> str:
    command = ["git", "-c", "user.name=x", "-c", "user.email=x@example.org", *arguments]
    env = module._environment_without_git()
    done = subprocess.run(command, cwd=folder, env=env, check=True, capture_output=True, text=True)
    return done.stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_revision_of_the_config_s_repository(monkeypatch, tmp_path):
    assert "git_revision" not in gather([], tmp_path)
    monkeypatch.setenv("GIT_DIR", "/nonexistent")
    git(tmp_path, "init")
    module._git.cache_clear()
    module._code.cache_clear()
    assert "git_revision" not in gather([], tmp_path)
    (tmp_path / "x.yaml").write_text("name: x\n")
    git(tmp_path, "add", "x.yaml")
    git(tmp_path, "commit", "-m", "x")
    module._git.cache_clear()
    module._code.cache_clear()
    facts = gather([], tmp_path)
    assert facts["git_revision"] == git(tmp_path, "rev-parse", "HEAD")
    assert facts["git_dirty"] == 0
    (tmp_path / "x.yaml").write_text("name: y\n")
    assert gather([], tmp_path)["git_dirty"] == 0  # asked once a process
    module._git.cache_clear()
    module._code.cache_clear()
    assert gather([], tmp_path)["git_dirty"] == 1


@pytest.mark.parametrize("error", [OSError("no git"), subprocess.TimeoutExpired("git", 2)])
def test_git_may_be_missing_or_slow(monkeypatch, tmp_path, error):
    def fail(*args, **kwargs):
        raise error

    monkeypatch.setattr(subprocess, "run", fail)
    assert "git_revision" not in gather([], tmp_path)


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_the_program_has_a_revision_of_its_own(tmp_path, monkeypatch):
    """Of the repository that tracks the program, whatever the config's; an environment in one has none."""
    here = tmp_path / "code" / "provenance.py"
    here.parent.mkdir()
    here.write_text("")
    monkeypatch.setattr(module, "__file__", str(here))
    git = ["git", "-C", str(here.parent), "-c", "user.name=x", "-c", "user.email=x@example.org"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    assert "code_revision" not in gather([], tmp_path)
    subprocess.run([*git, "add", "provenance.py"], check=True)
    subprocess.run([*git, "commit", "-q", "-m", "y"], check=True)
    done = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    module._code.cache_clear()
    module._git.cache_clear()
    facts = gather([], tmp_path)
    assert (facts["code_revision"], facts["code_dirty"]) == (done.stdout.strip(), 0)
    assert "git_revision" not in facts


@pytest.mark.parametrize(("system", "unit"), [("linux", 1024), ("darwin", 1)])
def test_memory_is_in_bytes_on_every_system(monkeypatch, system, unit):
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(resource, "getrusage", lambda who: SimpleNamespace(ru_maxrss=5))
    assert Clock((), None).facts()["peak_memory_bytes"] == 5 * unit
