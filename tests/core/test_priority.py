"""A process that leads a session sets the priority of the session, one that does not leaves it."""

import subprocess
import sys

import pytest

PROGRAM = """
import os
from contextlib import suppress
from pathlib import Path
from tt_core.priority import set_priority

def session_priority():
    # The file is missing in a kernel without autogroup, and empty where control groups share out the processor instead.
    with suppress(FileNotFoundError, IndexError):
        return Path("/proc/self/autogroup").read_text().split()[-1]

before = session_priority()
set_priority(7)
print(before, session_priority(), os.getpriority(os.PRIO_PROCESS, 0))
"""


@pytest.mark.parametrize("leads", [True, False])
def test_the_priority_of_a_session_is_that_of_its_leader(leads):
    done = subprocess.run([sys.executable, "-c", PROGRAM], start_new_session=leads, capture_output=True, text=True, check=True)
    before, after, own = done.stdout.split()
    assert own == "7"
    assert after == ("7" if leads and before != "None" else before)
