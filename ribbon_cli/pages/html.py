"""The little HTML that the pages share: escaped text, tables, pictures inside the page."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape as _escape

from ribbon_cli.text import visible

Cell = str | tuple[str, str]
"""A plain text, or a text with a class: `n` for numbers, `yes`, `no`, `open`."""

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem; }
h1, h2, h3 { line-height: 1.2; } h2 { margin-top: 3rem; border-top: 1px solid #ddd; padding-top: 1.5rem; }
table { border-collapse: collapse; font-size: 0.88rem; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; }
th, td { text-align: left; vertical-align: top; padding: 0.25rem 0.8rem 0.25rem 0;
  border-bottom: 1px solid #e4e4e4; }
td.n { text-align: right; white-space: nowrap; }
.yes { color: #00694b; font-weight: 600; white-space: nowrap; } .open { color: #666; }
.no { color: #b03a00; font-weight: 600; white-space: nowrap; } p.no { white-space: normal; }
figure { margin: 1rem 0; } figure img { max-width: 100%; height: auto; }
figcaption { color: #444; font-size: 0.92rem; }
pre { background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 0.82rem; }
.note { color: #555; font-size: 0.88rem; }
"""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""What a browser may load for a page: nothing but what is in it."""


def escape(text: str) -> str:
    """A text as HTML, in which nothing is a tag and nothing turns the direction of what follows."""
    return _escape(visible(text, "\n\t"))


def page(title: str, body: Iterable[str]) -> bytes:
    """A whole page."""
    head = (
        '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>"
    )
    text = "\n".join(body)
    parts = (
        "<!DOCTYPE html>",
        '<html lang="en">',
        "<head>",
        head,
        "</head>",
        "<body>",
        text,
        "</body>",
        "</html>",
    )
    return ("\n".join(parts) + "\n").encode()


def heading(level: int, text: str, anchor: str = "") -> str:
    """A heading, with an anchor to link to."""
    place = f' id="{escape(anchor)}"' if anchor else ""
    return f"<h{level}{place}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph of plain text."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def preformatted(text: str) -> str:
    """Text as it is, in a frame."""
    return f"<pre>{escape(text)}</pre>"


def picture(data: bytes, caption: str) -> str:
    """A PNG inside the page, with its caption."""
    image, text = base64.b64encode(data).decode("ascii"), escape(caption)
    shown = f'<img alt="{text}" src="data:image/png;base64,{image}">'
    return f"<figure>{shown}<figcaption>{text}</figcaption></figure>"


def table(head: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """A table of plain texts."""
    out = ['<div class="wide"><table><thead><tr>', *(f"<th>{escape(text)}</th>" for text in head)]
    out.append("</tr></thead><tbody>")
    for row in rows:
        out.append("<tr>")
        for cell in row:
            text, kind = cell if isinstance(cell, tuple) else (cell, "")
            out.append(f'<td class="{kind}">{escape(text)}</td>' if kind else f"<td>{escape(text)}</td>")
        out.append("</tr>")
    return "".join([*out, "</tbody></table></div>"])
