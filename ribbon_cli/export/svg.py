"""The fold pattern as SVG and PDF at true scale, on one sheet or on pages to be joined."""

from __future__ import annotations

import io
from xml.sax.saxutils import escape

import matplotlib
from matplotlib import style
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from ribbon_cli.export.pattern import Pattern
from ribbon_cli.export.sheet import COLOURS, DASHES, Line, Sheet, pages, sheet
from ribbon_cli.text import visible

POINT = 72 / 25.4
"""Points in a millimetre."""


def pattern_svg(pattern: Pattern, title: str, paper: str | None = None, number: int = 1) -> bytes:
    """One page of the pattern as SVG in millimetres; on paper, page `number` of `pages`.

    What is done along a line is its class, its colour and its layer: `cut`, `mountain`, `valley`, `flat` (a
    fold of no angle), `glue` or `text`. A fold has `data-node` (2..N) and `data-angle` in degrees, positive
    for a mountain; the end rulings have `data-end`. y runs downwards, as in any SVG.
    """
    drawn = sheet(pattern, title, paper, number)
    out = io.StringIO()
    out.write(
        '<svg xmlns="http://www.w3.org/2000/svg" '
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        f'width="{drawn.wide:.3f}mm" height="{drawn.tall:.3f}mm" '
        f'viewBox="0 0 {drawn.wide:.3f} {drawn.tall:.3f}" font-family="sans-serif">\n'
        f"<title>{escape(visible(title))}</title>\n"
        f'<metadata>{{"origin_x": {_number(drawn.origin[0])}, "origin_y": {_number(drawn.origin[1])}}}'
        "</metadata>\n"
    )
    for kind, colour in COLOURS.items():
        lines = [line for line in drawn.lines if line.kind == kind]
        texts = drawn.texts if kind == "text" else []
        if not lines and not texts:
            continue
        out.write(f'<g id="{kind}" inkscape:groupmode="layer" inkscape:label="{kind}">\n')
        for line in lines:
            out.write(_line(line, colour))
        for text in texts:
            x, y = map(_number, text.place)
            out.write(
                f'<text class="text" x="{x}" y="{y}" font-size="{_number(text.size)}" fill="{colour}">'
                f"{escape(text.text)}</text>\n"
            )
        out.write("</g>\n")
    out.write("</svg>\n")
    return out.getvalue().encode()


def _line(line: Line, colour: str) -> str:
    """A line as an element of its own, which says all about itself."""
    (x1, y1), (x2, y2) = (map(_number, end) for end in (line.start, line.end))
    data = "".join(f' {key}="{value}"' for key, value in line.data.items())
    dashes = f' stroke-dasharray="{DASHES[line.kind]}"' if line.kind in DASHES else ""
    return (
        f'<line class="{line.kind}"{data} x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" '
        f'fill="none" stroke="{colour}" stroke-width="{line.width:.3g}"{dashes}/>\n'
    )


def _number(value: float) -> str:
    """A coordinate in millimetres, exact to 1e-9."""
    return f"{value:.9f}".rstrip("0").rstrip(".")


def pattern_pdf(pattern: Pattern, title: str, paper: str | None = "A4") -> bytes:
    """The pattern as a PDF at true scale, one page a sheet. Raises UsageError as `pages` does."""
    buffer = io.BytesIO()
    metadata = {"Title": visible(title), "CreationDate": None, "ModDate": None}
    with matplotlib.rc_context():
        style.use("default")
        # Text stays text, in fonts that printers and cutters take.
        matplotlib.rcParams["pdf.fonttype"] = 42
        with PdfPages(buffer, metadata=metadata) as document:
            for page in pages(pattern, paper)[2]:
                drawn = sheet(pattern, title, paper, page.number)
                figure = Figure(figsize=(drawn.wide / 25.4, drawn.tall / 25.4))
                _draw(figure, drawn)
                document.savefig(figure)
    return buffer.getvalue()


def _draw(figure: Figure, drawn: Sheet) -> None:
    """One page: axes in millimetres that fill the sheet, y downwards as on the SVG."""
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, drawn.wide)
    axes.set_ylim(drawn.tall, 0)
    axes.axis("off")
    for line in drawn.lines:
        dashes = DASHES.get(line.kind)
        axes.plot(
            *zip(line.start, line.end, strict=True),
            color=COLOURS[line.kind],
            linewidth=line.width * POINT,
            linestyle=(0, tuple(float(d) / line.width for d in dashes.split())) if dashes else "-",
            solid_capstyle="butt",
            clip_on=False,
        )
    for text in drawn.texts:
        axes.text(
            *text.place,
            text.text,
            fontsize=text.size * POINT,
            va="baseline",
            color=COLOURS["text"],
            parse_math=False,
        )
