"""The wheel and the sdist as others get them: built, installed into empty environments, and put to work."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.package

ROOT = Path(__file__).parent.parent.parent
PYTHONS = os.environ.get("PACKAGE_PYTHONS", "python3.11 python3.12 python3.13").split()
MADE_BY_SETUPTOOLS = {"PKG-INFO", "setup.cfg"}
OWN_TESTS = ("test_packaging", "test_config", "test_store_npz", "test_everted_moebius", "test_docs")
"""Quick tests that read configs, data and pages."""


def run(*words: object, cwd: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """A command without what this environment would lend it; its output where it fails."""
    lent = ("PYTHONPATH", "VIRTUAL_ENV", "RIBBON_RUNS", "MAKEFLAGS")
    kept = {name: value for name, value in os.environ.items() if name not in lent}
    done = subprocess.run(list(map(str, words)), cwd=cwd, env=kept | changes, capture_output=True, text=True)
    assert done.returncode == 0, f"{words}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def works(python: str) -> bool:
    """Whether there is such an interpreter; a version manager's stand-in may be there and start none."""
    return (
        bool(shutil.which(python)) and subprocess.run([python, "-c", ""], capture_output=True).returncode == 0
    )


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The sdist, and the wheel made from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT, cwd=folder)
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


@pytest.fixture(scope="module")
def unpacked(built: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in the sdist."""
    folder = tmp_path_factory.mktemp("sdist")
    # The module tarfile has its filters, without which it warns, from 3.11.4 on.
    run("tar", "-xzf", built["sdist"], "-C", folder, cwd=folder)
    (inside,) = folder.iterdir()
    return inside


def environment(python: str, folder: Path, *packages: object) -> Path:
    """An empty environment with these packages and what they require; its folder of commands."""
    run(python, "-m", "venv", folder, cwd=folder.parent)
    pip = (folder / "bin" / "python", "-m", "pip", "-q", "--disable-pip-version-check")
    # Not compiled: most of what is installed is never imported.
    run(*pip, "install", "--no-compile", *packages, cwd=folder.parent)
    run(*pip, "check", cwd=folder.parent)
    return folder / "bin"


@pytest.mark.parametrize("kind", ["wheel", "sdist"])
@pytest.mark.parametrize("python", PYTHONS)
def test_it_solves_in_an_empty_environment(python, kind, built, tmp_path):
    if not works(python):
        pytest.skip(f"no {python} here")
    commands = environment(python, tmp_path / "venv", built[kind])
    ribbon, work = commands / "ribbon", tmp_path / "work"
    work.mkdir()
    assert run(ribbon, "--version", cwd=work).stdout.split()[-1] == built["wheel"].name.split("-")[1]
    run(ribbon, "init", "mobius-pi", "-o", "mobius-pi.yaml", cwd=work)
    run(ribbon, "-q", "solve", "mobius-pi.yaml", cwd=work)
    states = json.loads(run(ribbon, "ls", "mobius-pi", "--json", cwd=work).stdout)
    assert len(states) == 24
    assert all(state["certified"] and state["negative_eigenvalues"] == 0 for state in states)
    (one,) = (s for s in states if s["half_width"] == 0.5 and s["segments"] == 400)
    assert one["energy"] == pytest.approx(5.151432684, rel=1e-9)
    assert "0.00283882" in run(ribbon, "convergence-table", "mobius-pi.yaml", cwd=work).stdout
    # What needs files of data in the package: the viewer's page.
    run(ribbon, "export", "mobius-pi@b=0.5,N=100", "--to", "html", "-o", "x.html", cwd=work)
    run(ribbon, "report", "mobius-pi", "-o", "report.html", cwd=work)
    asked = "import ribbon_cli as r; print(r.load_state('mobius-pi@b=0.5,N=400').certified, r.__file__)"
    certified, place = run(commands / "python", "-c", asked, cwd=work).stdout.split()
    assert certified == "True"
    assert Path(place).is_relative_to(tmp_path / "venv")


def test_some_python_was_there():
    assert any(map(works, PYTHONS)), f"none of {PYTHONS} is here: name one in PACKAGE_PYTHONS"


def test_the_sdist_holds_what_the_repository_holds(unpacked):
    listed = run("git", "ls-files", "-z", cwd=ROOT).stdout.split("\0")
    wanted = {name for name in listed if name and name != ".gitignore"}
    found = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    made = {name for name in found if name in MADE_BY_SETUPTOOLS or name.startswith("ribbon.egg-info/")}
    assert found - made == wanted


def test_the_wheel_holds_the_package_and_nothing_else(built, unpacked):
    names = set(zipfile.ZipFile(built["wheel"]).namelist())
    package = {
        p.relative_to(unpacked).as_posix() for p in (unpacked / "ribbon_cli").rglob("*") if p.is_file()
    }
    assert {name for name in names if ".dist-info/" not in name} == package
    assert any(name.endswith("/licenses/LICENSE") for name in names)


def test_the_sdist_passes_its_own_tests(unpacked):
    """All tests are found with their helpers and data; the quick ones that read files pass."""
    tests = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider")
    run(*tests, "--collect-only", cwd=unpacked)
    place = run(sys.executable, "-c", "import ribbon_cli; print(ribbon_cli.__file__)", cwd=unpacked)
    assert Path(place.stdout.strip()).is_relative_to(unpacked)
    files = [f"tests/{name}.py" for name in OWN_TESTS]
    done = run(*tests, *files, "-k", "not examples_run", cwd=unpacked)
    assert " passed" in done.stdout


def test_programs_that_use_it_are_type_checked(built, tmp_path):
    """`py.typed` is there: mypy takes the annotations and does not call everything Any."""
    folder = tmp_path / "site"
    with zipfile.ZipFile(built["wheel"]) as wheel:
        wheel.extractall(folder)
    (tmp_path / "used.py").write_text(
        "from ribbon_cli import load_state, solve\nenergy: str = load_state('x').energy\nsolve(1)\n",
        encoding="utf-8",
    )
    venv = tmp_path / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", venv, cwd=tmp_path)
    (packages,) = venv.glob("lib/python*/site-packages")
    shutil.copytree(folder, packages, dirs_exist_ok=True)
    python = f"--python-executable={venv / 'bin' / 'python'}"
    words = [sys.executable, "-m", "mypy", python, "--no-incremental", "used.py"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1, done.stdout
    kinds = [line.rpartition("[")[2].rstrip("]") for line in done.stdout.splitlines() if "error:" in line]
    assert kinds == ["assignment", "arg-type"], done.stdout


def test_the_citation_is_valid(tmp_path):
    """cffconvert has an environment of its own: it needs an old jsonschema."""
    commands = environment(sys.executable, tmp_path / "venv", "cffconvert>=2.0")
    path = ROOT / "CITATION.cff"
    assert "are valid" in run(commands / "cffconvert", "--validate", "-i", path, cwd=tmp_path).stdout
    assert (
        "The ribbon developers"
        in run(commands / "cffconvert", "-f", "bibtex", "-i", path, cwd=tmp_path).stdout
    )
