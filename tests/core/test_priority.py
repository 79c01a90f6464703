"""A process that leads a session sets the priority of the session, one that does not leaves it."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
from pathlib import Path
from tt_core.priority import set_priority
set_priority(7)
print(Path("/proc/self/autogroup").read_text().split()[-1], __import__("os").getpriority(0, 0))
"""


@pytest.mark.skipif(not Path("/proc/self/autogroup").exists(), reason="this kernel has no autogroup")
@pytest.mark.parametrize("leads", [True, False])
def test_the_priority_of_a_session_is_that_of_its_leader(leads):
    before = Path("/proc/self/autogroup").read_text().split()[-1]
    done = subprocess.run([sys.executable, "-c", PROGRAM], start_new_session=leads, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["7" if leads else before, "7"]
    assert Path("/proc/self/autogroup").read_text().split()[-1] == before
