"""The HTML viewer in a real browser: `make test-browser`. Not part of `make test`, which needs no browser."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))

from chromium import Chromium
from picture_support import solved, states_of  # noqa: F401

from ribbon_cli.api import solve
from ribbon_cli.config import parse_config
from ribbon_cli.export.viewer import viewer_html

pytestmark = pytest.mark.browser

LARGEST = 3_000_000


@pytest.fixture(scope="module")
def branch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of 20 widths at N = 200."""
    folder = tmp_path_factory.mktemp("branch")
    text = (
        "name: branch\ntopology: {half_twists: 1}\nrefinement: [200]\nspectrum: {modes: 0, full_up_to: 0}\n"
        "initial_guess: {recipe: twist, segments: 200, half_width: 0.1, steps: 20}\n"
        "widths: {from: 0.1, to: 0.86, steps: 19}\n"
    )
    run = solve(parse_config(text, "branch"), runs=folder).run
    states = [run.load(state.label) for state in run.states()]
    assert len(states) == 20
    path = folder / "branch.html"
    path.write_bytes(viewer_html(states, "a branch", run.name))
    return path


@pytest.fixture
def browser(branch: Path, tmp_path: Path) -> Iterator[Chromium]:
    chromium = Chromium(tmp_path / "profile")
    try:
        chromium.open(branch)
        yield chromium
        assert chromium.errors == []
    finally:
        chromium.close()


def test_the_page_is_small(branch):
    assert branch.stat().st_size < LARGEST


def test_nothing_is_blank_and_nothing_is_fetched(browser, branch):
    assert browser.colours("#shape") > 200
    for name in ("#curve-kappa_s", "#curve-eta"):
        assert browser.colours(name) > 20
    browser.evaluate("document.querySelector('#field').value = 'tau'")
    assert browser.requests == [branch.as_uri()]


def test_the_slider_moves_the_shape_and_the_curves(browser):
    before = [browser.pixels(name) for name in ("#shape", "#curve-kappa_s", "#curve-eta")]
    assert browser.evaluate("+document.querySelector('#width').max") == 19
    browser.evaluate(
        "(() => { const w = document.querySelector('#width'); w.value = 3;"
        " w.dispatchEvent(new Event('input')); })()"
    )
    after = [browser.pixels(name) for name in ("#shape", "#curve-kappa_s", "#curve-eta")]
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert "b = 0.22" in browser.evaluate("document.querySelector('#b').textContent")


def test_the_mouse_and_a_finger_turn_the_shape(browser):
    start = browser.pixels("#shape")
    browser.mouse("mousePressed", 300, 300, pressed=True)
    browser.mouse("mouseMoved", 380, 330, pressed=True)
    browser.mouse("mouseReleased", 380, 330)
    turned = browser.pixels("#shape")
    assert turned != start
    browser.touch("touchStart", (300, 300))
    browser.touch("touchMove", (250, 260))
    browser.touch("touchEnd")
    assert browser.pixels("#shape") != turned


def test_two_fingers_zoom(browser):
    browser.touch("touchStart", (280, 300), (320, 300))
    browser.touch("touchMove", (220, 300), (380, 300))
    browser.touch("touchEnd")
    assert browser.evaluate("view.zoom") > 1.5


@pytest.mark.parametrize("name", ["kappa_s", "eta_prime", "lambda_5"])
def test_fields_colour_the_shape(browser, name):
    paper = browser.pixels("#shape")
    browser.evaluate(
        f"(() => {{ const f = document.querySelector('#field'); f.value = {name!r};"
        " f.dispatchEvent(new Event('change')); })()"
    )
    assert browser.pixels("#shape") != paper
    assert browser.evaluate("!document.querySelector('#bar').hidden")


def test_a_place_on_a_curve_is_shown_on_the_shape(browser):
    before = browser.pixels("#shape")
    box = browser.evaluate(
        "(() => { const r = document.querySelector('#curve-eta').getBoundingClientRect();"
        " return [r.left + r.width / 2, r.top + r.height / 2]; })()"
    )
    browser.mouse("mouseMoved", *box)
    assert browser.pixels("#shape") != before
    assert browser.evaluate("view.mark") >= 0


def test_titles_cannot_inject(solved, tmp_path):  # noqa: F811
    (state, *_) = states_of(solved, "ring")
    path = tmp_path / "page.html"
    path.write_bytes(
        viewer_html([replace(state, status="</script><b id=x>")], "<img id=x src=y>", "</script>")
    )
    chromium = Chromium(tmp_path / "profile")
    try:
        chromium.open(path)
        assert chromium.evaluate("document.querySelector('#x')") is None
        assert chromium.colours("#shape") > 50
        assert chromium.errors == []
    finally:
        chromium.close()
