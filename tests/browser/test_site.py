"""The documentation's site in a real browser, opened from the disk: `make test-browser` builds it first."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))

from chromium import Chromium

pytestmark = pytest.mark.browser

SITE = Path(__file__).parent.parent.parent / "build" / "site"
MISSING = "[...document.images].filter(image => !image.naturalWidth).map(image => image.src)"
LINKS = '[...document.querySelectorAll(\'a[href^="file:"], a:not([href*="://"])\')].map(link => link.href)'
IDS = "[...document.querySelectorAll('[id]')].map(element => element.id)"
LOADED = (
    "Promise.all([...document.images].map(i => { i.loading = 'eager'; return i.decode().catch(() => 0); }))"
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    chromium = Chromium(tmp_path_factory.mktemp("site") / "profile")
    try:
        yield chromium
    finally:
        chromium.close()


def test_pages_open_with_their_pictures_and_links(browser: Chromium) -> None:
    pages = sorted(SITE.rglob("*.html"))
    assert len(pages) > 30, "make docs builds the site"
    links, anchors = {}, {}
    for page in pages:
        browser.errors.clear()
        browser.open(page)
        browser.evaluate(LOADED)
        assert browser.errors == [], page
        assert browser.evaluate(MISSING) == [], page
        links[page], anchors[page.as_uri()] = browser.evaluate(LINKS), {"", *browser.evaluate(IDS)}
    assert not [url for url in browser.requests if not url.startswith(("file:", "data:"))]
    for page, found in links.items():
        for link in found:
            target, _, anchor = link.partition("#")
            if target in anchors:
                assert anchor in anchors[target] or unquote(anchor) in anchors[target], (page, link)
            else:
                assert Path(unquote(target.removeprefix("file://"))).is_file(), (page, link)


def test_pictures_are_there(browser: Chromium) -> None:
    for page, least in (("index.html", 1), ("docs/tutorial.html", 4), ("docs/notebook.html", 5)):
        browser.open(SITE / page)
        assert browser.evaluate("document.querySelectorAll('article img').length") >= least, page


@pytest.mark.parametrize(("words", "page"), [("eversion", "recipes.html"), ("to_xarray", "api.html")])
def test_the_search_finds(browser: Chromium, words: str, page: str) -> None:
    browser.errors.clear()
    browser.send("Page.navigate", url=f"{(SITE / 'search.html').as_uri()}?q={words}")
    found = browser.evaluate(
        """new Promise(done => {
          let left = 100;
          const look = () => {
            const links = [...document.querySelectorAll('#search-results li a')].map(link => link.href);
            const text = document.querySelector('#search-results .search-summary, #search-results p');
            if ((links.length && text && /finished|found/i.test(text.textContent)) || --left < 0) done(links);
            else setTimeout(look, 100);
          };
          look();
        })"""
    )
    assert any(page in link for link in found), found
    assert browser.errors == []
