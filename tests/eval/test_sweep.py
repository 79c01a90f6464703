"""Many balls: the same however they are cut, interrupted and distributed."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from refusals import check_named
from tt_eval import rallies
from tt_eval.evaluate import SCORING_ERRORS, Sweep, returns, scoring_errors
from tt_eval.evaluate import main as evaluate
from tt_eval.scenario import load
from tt_eval.sweep import NoScheduler, OtherSweep, simulate_balls, sweep

SCENARIO = load("liu", images=False)
BALLS = 24


@pytest.fixture(scope="module")
def whole():
    return simulate_balls(SCENARIO, 0, BALLS)


def test_a_sweep_is_its_balls_however_it_is_cut(whole, tmp_path):
    out = tmp_path / "run.parquet"
    sweep(SCENARIO, BALLS, out, workers=2, size=7)
    assert _same(pq.read_table(out), whole)
    assert pq.read_schema(out).metadata[b"scenario"] == b"liu"
    assert [p.name for p in tmp_path.iterdir()] == ["run.parquet"]


def _same(one, other):
    """As text, in which a NaN equals a NaN and every digit counts."""
    return str(one.to_pylist()) == str(other.to_pylist())


def test_an_interrupted_sweep_goes_on_where_it_was(whole, tmp_path):
    out = tmp_path / "run.parquet"
    command = [sys.executable, "-m", "tt_eval.sweep", "liu", "--balls", "100000", "--out", str(out), "--workers", "1"]
    process = psutil.Popen(command, env=os.environ)
    parts, end = tmp_path / "run.parquet.parts", time.monotonic() + 60
    while not list(parts.glob("*.parquet")):
        assert time.monotonic() < end and process.poll() is None
        time.sleep(0.1)
    children = process.children(recursive=True)
    process.kill()
    process.wait()
    assert children and not psutil.wait_procs(children, timeout=60)[1]  # they end by themselves
    first = next(iter(sorted(parts.glob("*.parquet"))))
    assert str(pq.read_table(first).slice(0, BALLS).to_pylist()) == str(whole.to_pylist())
    with pytest.raises(OtherSweep) as error:
        sweep(SCENARIO, BALLS, out)
    assert error.value.folder == parts


def test_what_is_done_is_not_done_again(tmp_path, monkeypatch, whole, capsys):
    import tt_eval.sweep as module

    out, done = tmp_path / "run.parquet", []

    def some(scenario, missing, executor, workers):
        for first, last in missing:
            done.append(first)
            if len(done) == 3:
                raise KeyboardInterrupt
            yield first, simulate_balls(scenario, first, last)

    monkeypatch.setattr(module, "parts", some)
    with pytest.raises(KeyboardInterrupt):
        sweep(SCENARIO, BALLS, out, workers=1, size=8)
    assert not out.exists()
    sweep(SCENARIO, BALLS, out, workers=1, size=8)
    assert done == [0, 8, 16, 16]
    assert f"16 of {BALLS} balls" in capsys.readouterr().err  # no terminal: a line for each tenth
    assert _same(pq.read_table(out), whole)


def _json(path):
    """The contents of a file; None while it is not there or not written to its end."""
    try:
        return json.loads(path.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return None


def test_a_cluster_plays_the_same_balls(whole, tmp_path):
    """A scheduler and two workers, each a process of its own, found by address."""
    address = tmp_path / "scheduler.json"
    common = ["--scheduler-file", str(address), "--no-dashboard"]
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", "0", *common]
    worker = ["worker", "--nthreads", "1", "--no-nanny", *common]
    starts = [[sys.executable, "-m", "dask", *words] for words in (scheduler, worker, worker)]
    processes = [subprocess.Popen(start, cwd=tmp_path, stderr=subprocess.DEVNULL, env=os.environ) for start in starts]
    try:
        end = time.monotonic() + 60
        while (found := _json(address)) is None:
            assert time.monotonic() < end
            time.sleep(0.1)
        out = tmp_path / "run.parquet"
        sweep(SCENARIO, BALLS, out, scheduler=found["address"], size=5)
        assert _same(pq.read_table(out), whole)
    finally:
        for process in reversed(processes):  # a worker without a scheduler waits for it
            process.terminate()
            process.wait(20)


def test_a_wrong_call_is_refused_before_anything_starts(tmp_path, monkeypatch):
    command = [sys.executable, "-m", "tt_eval.sweep"]
    bad = tmp_path / "bad.yaml"
    bad.write_text("launcher: {rate: -3}")
    done = subprocess.run([*command, str(bad), "--out", str(tmp_path / "run.parquet")], capture_output=True, text=True, env=os.environ)
    assert done.returncode == 2 and "bad.yaml: launcher.rate: " in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["bad.yaml"]
    monkeypatch.setattr("tt_eval.sweep.CONNECT", 0.5)
    with pytest.raises(NoScheduler) as error:
        sweep(SCENARIO, 1, tmp_path / "run.parquet", scheduler="tcp://127.0.0.1:1")
    assert error.value.address == "tcp://127.0.0.1:1"


def test_an_evaluation_is_a_table_and_a_page(whole, tmp_path, monkeypatch, capsys):
    run, page = tmp_path / "liu.parquet", tmp_path / "page.html"
    pq.write_table(whole, run)
    monkeypatch.setattr(sys, "argv", ["evaluate", str(run), "--page", str(page)])
    evaluate()
    assert str(BALLS) in capsys.readouterr().out
    text = page.read_text()
    titles = ("Landing places", "Landing off, cm, against spin, rpm", "Why balls were missed", "Figures 4.7 to 4.10", "The judge")
    assert all(title in text for title in titles)


def test_what_the_judge_gets_wrong_is_told(whole, tmp_path):
    run = tmp_path / "liu.parquet"
    pq.write_table(whole, run)
    sweep = Sweep.read(run)
    off = sweep.numbers["judged_landing_x"] - sweep.numbers["landing_x"]
    errors = dict(zip(SCORING_ERRORS, scoring_errors(sweep), strict=True))
    assert errors["landing x, mm"] == f"{1e3 * off.mean():+.2f} ± {1e3 * off.std():.2f}"
    assert np.abs(off).max() < 2e-3  # m; 1 mm at most in 200 balls on the day
    assert errors["miss told otherwise, balls"] == "0"
    true, judged = returns(sweep.numbers, sweep.misses), returns(sweep.numbers, sweep.judged, "judged_")
    assert true[:3] == judged[:3] == [str(BALLS), "100.0", "100.0"]


def test_a_file_that_is_no_sweep_is_refused(tmp_path, whole, monkeypatch, capsys):
    bad, old, missing = tmp_path / "bad.parquet", tmp_path / "old.parquet", tmp_path / "none.parquet"
    bad.write_text("no parquet")
    pq.write_table(whole.drop_columns(["judged_landed"]), old)
    for file, *named in ((bad,), (old, "judged_landed"), (missing,)):
        monkeypatch.setattr(sys, "argv", ["evaluate", str(file)])
        with pytest.raises(SystemExit) as ended:
            evaluate()
        assert ended.value.code == 2
        check_named(capsys.readouterr().err, file, *named)


def test_balls_that_are_not_there_are_refused_before_anything_starts(tmp_path, monkeypatch):
    monkeypatch.delenv("TT_DATA_DIR", raising=False)
    rallies.reachable_shots.cache_clear()
    with pytest.raises(rallies.NoShots):
        sweep(load("rallies", images=False), 10, tmp_path / "run.parquet")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("speed: 3", ("mine.yaml", "speed")),
        ("world: {cameras: {dropped: 2.0}}", ("mine.yaml", "world.cameras.dropped", 2)),
        ("launcher: {rate: -3}", ("mine.yaml", "launcher.rate", -3)),
        ("a: [1", ("mine.yaml",)),
    ],
)
def test_a_wrong_scenario_is_refused_on_the_command_line(content, named, tmp_path):
    """By a process of its own, as its user sees it: exit code 2, the path in the file, no traceback, and nothing was begun."""
    (tmp_path / "mine.yaml").write_text(content)
    out = tmp_path / "run.parquet"
    command = [sys.executable, "-m", "tt_eval.sweep", str(tmp_path / "mine.yaml"), "--balls", "10", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and done.stdout == ""
    check_named(done.stderr, *named)
    assert "Traceback" not in done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["mine.yaml"]
