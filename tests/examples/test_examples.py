"""Every example runs and prints what its README shows."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ROUNDING = 1e-6  # printed numbers below this are rounding errors, which differ from processor to processor


def shown(name):
    """The output of a program as examples/README.md shows it."""
    return re.search(rf"^## {name}\n.*?^```\n(.*?)^```", (EXAMPLES / "README.md").read_text(), re.DOTALL | re.MULTILINE)[1]


def numbers(text):
    return [0.0 if abs(value) < ROUNDING else value for value in map(float, NUMBER.findall(text))]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_an_example_prints_what_its_readme_shows(program):
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    wanted = shown(program.name)
    assert re.sub(r"[\s.]", "", NUMBER.sub("", done.stdout)) == re.sub(r"[\s.]", "", NUMBER.sub("", wanted))
    # 2 %: an optimizer may end elsewhere within its tolerance on another processor; 0.002: the last digit printed
    assert numbers(done.stdout) == pytest.approx(numbers(wanted), rel=0.02, abs=0.002)


def test_there_are_at_least_six_short_ones():
    assert len(PROGRAMS) >= 6
    assert all(len(path.read_text().splitlines()) <= 60 for path in PROGRAMS)
