"""HTML pages of tables and figures that need no network, with one template and style for all pages.

A page is small because the code that draws its figures is in the file plotly.min.js beside it, which all pages of a folder share.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.offline import get_plotlyjs

BLUE, ORANGE, GREEN, YELLOW, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9"
COLOURS = (BLUE, ORANGE, GREEN, YELLOW, PURPLE, SKY, "#8c6d31", "#888888")  # after Okabe and Ito: told apart by the colour-blind
GREY = "#808892"  # colour of lines that must be visible on a light and on a dark background
PLOTLY = "plotly.min.js"
WHOLE_WIDTH = "whole"  # `meta` of the layout of a figure that takes the whole width


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Attributes:
        head: Headings of the columns.
        rows: Rows, each with as many cells.
        title: Title above the table; "" for none.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a page: its text, its tables, then its figures.

    Attributes:
        title: Title above the part; "" for none.
        text: Paragraphs below the title.
        tables: Tables.
        figures: Plotly figures, two in a row where there is room for them, or one if its `layout.meta` is WHOLE_WIDTH. The title of the
            layout is written above the figure.
        html: HTML below the figures, as markupsafe.Markup.
    """

    title: str = ""
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[go.Figure] = ()
    html: str = ""


def figure_data(figure: go.Figure) -> str:
    """Return data and layout of a figure as JSON, for the function `drawFigure` of a page, which adds the colours of the page."""
    bare = go.Figure(figure).update_layout(title=None, template=go.layout.Template())
    return str(bare.to_json()).replace("</", "<\\/")  # so that no text of it ends the script that holds it


def html_page(
    title: str,
    sections: Sequence[Section],
    *,
    lead: Sequence[str] = (),
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
) -> str:
    """Return a page as HTML. Every text in it is escaped.

    Args:
        title: Title of the page.
        sections: Parts of the page, in order.
        lead: Paragraphs at the top, a summary.
        scripts: JavaScript that runs after the figures are drawn.
        styles: CSS in addition to that of all pages.
    """
    folder = files(__package__) / "pages"
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string((folder / "page.html").read_text())
    return template.render(
        title=title,
        sections=sections,
        lead=lead,
        draw=_draw,
        drawing=Markup((folder / "draw.js").read_text()),
        scripts=[Markup(script) for script in scripts],
        styles=[Markup(style) for style in styles],
    )


def write_page(file: Path, page: str) -> None:
    """Write a page to a file, and the code that draws its figures to a file beside it.

    Args:
        file: The file; its folder is created if it does not exist.
        page: The page as HTML.

    Raises:
        OSError: A file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    drawing = get_plotlyjs()
    beside = file.parent / PLOTLY
    if not beside.is_file() or beside.stat().st_size != len(drawing.encode()):
        beside.write_text(drawing)
    file.write_text(page)


def _draw(figure: go.Figure) -> Markup:
    """Return a figure as HTML: its title, its place, and its data."""
    kind = Markup(' class="whole"') if figure.layout.meta == WHOLE_WIDTH else ""
    height = figure.layout.height or 380
    place = Markup('<div class="drawn" style="height: {}px"></div><script type="application/json">{}</script>')
    drawn = place.format(height, Markup(figure_data(figure)))
    return Markup("<figure{}><figcaption>{}</figcaption>{}</figure>").format(kind, figure.layout.title.text or "", drawn)


def script_call(function: str, *values: object) -> str:
    """Return a line of JavaScript that calls a function.

    Args:
        function: Name of the function.
        values: Its arguments, which must be convertible to JSON.
    """
    given = ", ".join(json.dumps(value) for value in values).replace("</", "<\\/")
    return f"{function}({given});\n"
