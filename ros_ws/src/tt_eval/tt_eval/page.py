"""Write pages of tables and figures that need no network: one template and one style for all of them.

A page is small because the code that draws its figures is the file plotly.min.js beside it, which all pages of a folder share.
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
GREY = "#808892"  # of lines that are seen on light and on dark paper
PLOTLY = "plotly.min.js"
WHOLE = "whole"  # `meta` of the layout of a figure that takes the whole width


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Attributes:
        head: Heads of the columns.
        rows: As many cells each.
        title: Above it, if any.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a page: its text, its tables, then its figures.

    Attributes:
        title: Above it, if any.
        text: Sentences below the title, a paragraph each.
        tables: Tables.
        figures: Plotly figures, two in a row where there is room for them, or one if its `layout.meta` is WHOLE. The title of the layout
            stands above the figure.
        html: What follows them, as markupsafe.Markup.
    """

    title: str = ""
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[go.Figure] = ()
    html: str = ""


def figure_data(figure: go.Figure) -> str:
    """Return data and layout of a figure as JSON, for `drawFigure` of a page, which adds the colours of the page."""
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
    """Return a page; every text in it is escaped.

    Args:
        title: Of the page.
        sections: Its parts, in order.
        lead: What it says in short, a paragraph each.
        scripts: JavaScript that runs after the figures are drawn.
        styles: CSS beside that of all pages.
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
    """Write a page, and beside it the code that draws its figures. Raises OSError."""
    file.parent.mkdir(parents=True, exist_ok=True)
    drawing = get_plotlyjs()
    beside = file.parent / PLOTLY
    if not beside.is_file() or beside.stat().st_size != len(drawing.encode()):
        beside.write_text(drawing)
    file.write_text(page)


def _draw(figure: go.Figure) -> Markup:
    """Return a figure as HTML: its title, its place, and its data."""
    kind = Markup(' class="whole"') if figure.layout.meta == WHOLE else ""
    height = figure.layout.height or 380
    place = Markup('<div class="drawn" style="height: {}px"></div><script type="application/json">{}</script>')
    drawn = place.format(height, Markup(figure_data(figure)))
    return Markup("<figure{}><figcaption>{}</figcaption>{}</figure>").format(kind, figure.layout.title.text or "", drawn)


def script_call(function: str, *values: object) -> str:
    """Return a line of JavaScript that calls a function with values that JSON can hold."""
    given = ", ".join(json.dumps(value) for value in values).replace("</", "<\\/")
    return f"{function}({given});\n"
