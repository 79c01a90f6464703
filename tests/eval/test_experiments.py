"""The experiments run, and what they show is in their files."""

import sys

import pytest
from refusals import check_named
from tt_eval.experiments import main, robustness


@pytest.mark.parametrize("name, titles", [("rotation", ("Figure 2.14", "Figure 2.15")), ("catapult", ("Figure 2.17", "Figure 2.20"))])
def test_an_experiment_prints_its_table_and_saves_its_figures(name, titles, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["experiment", name, "--runs", "1", "--out", str(tmp_path)])
    main.main()
    assert {"rotation": "Method 2", "catapult": "as printed"}[name] in capsys.readouterr().out
    page = (tmp_path / f"{name}.html").read_text()
    assert all(title in page for title in titles)


def test_conditions_can_be_made_worse(monkeypatch, capsys):
    monkeypatch.setattr(robustness, "SWEEPS", {name: robustness.SWEEPS[name] for name in ("as it is", "one camera")})
    (figure,) = robustness.run(1)
    assert len(figure.data) == 2
    check_named(capsys.readouterr().out, "one camera")
