"""A page holds its tables and figures, escaped, and needs no network."""

import plotly.graph_objects as go
from tt_eval.page import Section, Table, html_page


def test_a_page_holds_what_it_is_given_escaped():
    figure = go.Figure().add_scatter(y=[1, 2]).update_layout(title="a figure")
    table = Table(("ball", "place"), [("1 < 2", "<b>here</b>")], "places & times")
    text = html_page("a & b", [Section("", [table]), Section("two", figures=[figure, figure])])
    assert "<title>a &amp; b</title>" in text and "<h3>places &amp; times</h3>" in text
    assert "<td>1 &lt; 2</td><td>&lt;b&gt;here&lt;/b&gt;</td>" in text
    assert text.count("<h2>") == 1 and text.count('"a figure"') == 2
    assert 'src="http' not in text and "<link" not in text
    assert len(text) < 1.5 * len(html_page("", [Section(figures=[figure])]))  # the code that draws is there once
