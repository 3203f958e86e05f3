"""Making figures: states from the library, files into a folder, and the page of all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from paper.figures import ITEMS, STYLE
from paper.library import Library
from paper.page import paper_page
from ribbon_cli.errors import StoreError
from ribbon_cli.plot.figure import image
from ribbon_cli.plot.style import styled
from ribbon_cli.store import write_atomic

if TYPE_CHECKING:
    from paper.figures import Made


def make(names: Sequence[str], library: Library, to: Path, say: Callable[[str], None]) -> dict[str, Made]:
    """Make figures and tables by name, all and the page `index.html` for none, into the folder `to`.

    `say` is told of each file and each claim that does not hold. Raises KeyError for an unknown name,
    ConfigError and StoreError as solving does.
    """
    try:
        os.makedirs(to, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{to}: cannot be made: {error.strerror}") from error
    made: dict[str, Made] = {}
    images: dict[str, bytes] = {}
    for name in names or ITEMS:
        with styled(STYLE):
            made[name] = ITEMS[name].make(library)
        images |= _write(name, made[name], to)
        held = sum(check.agrees is True for check in made[name].checks)
        say(f"{to / name}: {held} of {len(made[name].checks)} claims hold")
    if not names:
        texts = {
            config: library.path(config).read_text(encoding="utf-8")
            for config in {config for item in ITEMS.values() for config in item.configs}
        }
        write_atomic(to / "index.html", paper_page(ITEMS, made, images, texts), overwrite=True)
        say(f"{to / 'index.html'}: all of them on one page")
    return made


def _write(name: str, made: Made, to: Path) -> dict[str, bytes]:
    """Write a figure's files and return the PNG of the whole by its name."""
    images = {}
    caption = f"{ITEMS[name].caption} States: {', '.join(made.sources)}."
    for panel, figure in made.pictures.items():
        stem = f"{name}-{panel}" if panel else name
        for form in ("pdf", "png"):
            data = image(figure, form, STYLE, stem, caption)
            write_atomic(to / f"{stem}.{form}", data, overwrite=True)
            if form == "png" and not panel:
                images[name] = data
    for suffix, text in made.texts.items():
        write_atomic(to / f"{name}.{suffix}", text.encode(), overwrite=True)
    return images
