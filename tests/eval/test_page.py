"""A page holds its tables and figures, escaped, needs no network, and is small."""

import json
import re

import numpy as np
import plotly.graph_objects as go
from tt_eval.page import PLOTLY, WHOLE_WIDTH, Section, Table, figure_data, html_page, script_call, write_page

SMALL = 1_500_000  # bytes, that a page may have


def test_a_page_holds_what_it_is_given_escaped():
    figure = go.Figure().add_scatter(y=[1, 2]).update_layout(title="a < figure", height=300)
    table = Table(("ball", "place"), [("1 < 2", "<b>here</b>")], "places & times")
    sections = [Section("", tables=[table]), Section("two", text=["so & so"], figures=[figure, figure.update_layout(meta=WHOLE_WIDTH)])]
    text = html_page("a & b", sections, lead=["in <short>"])
    assert "<title>a &amp; b</title>" in text and "<h3>places &amp; times</h3>" in text
    assert "<td>1 &lt; 2</td><td>&lt;b&gt;here&lt;/b&gt;</td>" in text
    assert "<p>so &amp; so</p>" in text and "<p>in &lt;short&gt;</p>" in text
    assert text.count("<h2>") == 1 and text.count("<figcaption>a &lt; figure</figcaption>") == 2 and text.count("height: 300px") == 2
    assert 'src="http' not in text and "<link" not in text
    assert 'name="viewport"' in text and "prefers-color-scheme: dark" in text


def test_what_draws_the_figures_is_beside_the_page(tmp_path):
    for name in ("one.html", "two.html"):
        write_page(tmp_path / "pages" / name, html_page(name, [Section(figures=[go.Figure().add_scatter(y=np.arange(20_000.0))])]))
        assert (tmp_path / "pages" / name).stat().st_size < SMALL
    assert f'src="{PLOTLY}"' in (tmp_path / "pages" / "two.html").read_text()
    assert "plotly.js" in (tmp_path / "pages" / PLOTLY).read_text()[:500]


def test_text_of_a_figure_does_not_end_its_script():
    figure = go.Figure().add_scatter(y=[1], name="</script><b>")
    assert "</script>" not in figure_data(figure) and json.loads(figure_data(figure))["data"][0]["name"] == "</script><b>"
    line = script_call("report", 1, {"text": "</script>"})
    assert line.endswith(");\n") and "</script>" not in line
    assert json.loads(re.fullmatch(r"report\(1, (.*)\);\n", line)[1]) == {"text": "</script>"}
