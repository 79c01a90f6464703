"""One HTML page of tables and figures that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jinja2
import plotly.graph_objects as go
from markupsafe import Markup

TEMPLATE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{{ title }}</title>
<style>
body { font: 15px sans-serif; max-width: 1200px; margin: 2em auto; color: #222 }
table { border-collapse: collapse; margin-bottom: 1.5em }
td, th { padding: .25em .8em; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd }
td:first-child { color: #555; white-space: nowrap }
h2 { border-bottom: 2px solid #1b5e9b; padding-bottom: .2em; margin-top: 2em }
</style>
</head>
<body>
<h1>{{ title }}</h1>
{% for section in sections %}
{% if section.title %}<h2>{{ section.title }}</h2>{% endif %}
{% for table in section.tables %}
{% if table.title %}<h3>{{ table.title }}</h3>{% endif %}
<table>
<tr>{% for cell in table.head %}<th>{{ cell }}</th>{% endfor %}</tr>
{% for row in table.rows %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</table>
{% endfor %}
{% for figure in section.figures %}{{ draw(figure) }}
{% endfor %}
{% endfor %}
</body>
</html>
"""


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
    """A part of a page: its tables, then its figures.

    Attributes:
        title: Above it, if any.
        tables: Tables.
        figures: Plotly figures.
    """

    title: str = ""
    tables: Sequence[Table] = ()
    figures: Sequence[go.Figure] = ()


def html_page(title: str, sections: Sequence[Section]) -> str:
    """Return the page; every text in it is escaped."""
    drawn = 0

    def draw(figure: go.Figure) -> str:
        """Return a figure as HTML, the first one with the code that draws all."""
        nonlocal drawn
        drawn += 1
        return str(figure.to_html(full_html=False, include_plotlyjs=drawn == 1))

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(TEMPLATE)
    return template.render(title=title, sections=sections, draw=lambda figure: Markup(draw(figure)))
