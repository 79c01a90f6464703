"""docs/swing.py, as a user calls it."""

import re
import subprocess
import sys
from pathlib import Path

from refusals import check_named

ROOT = Path(__file__).parents[2]


def draw(*arguments):
    return subprocess.run([sys.executable, ROOT / "docs/swing.py", *arguments], capture_output=True, text=True, timeout=120)


def test_a_swing_is_drawn_around_its_strike(tmp_path):
    page = tmp_path / "swing.html"
    done = draw("top 3", page)
    assert done.returncode == 0, done.stderr
    off = float(re.findall(r"\d+\.\d+", done.stdout)[0])
    assert off < 0.1  # degrees; an arm with 5 ms of lag is 0.03 off
    assert "s from the strike" in page.read_text()


def test_a_recording_without_a_swing_is_refused_by_name(tmp_path):
    done = draw(ROOT / "bags/reference_back_5", tmp_path / "swing.html")
    assert done.returncode == 1
    check_named(done.stderr, "reference_back_5", "arm/swing")
