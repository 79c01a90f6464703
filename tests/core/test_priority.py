"""A process that leads a session sets the nice value of the session; real-time priorities are for all threads that have none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tt_core.priority import reset_nice

PROGRAM = """
import os
from contextlib import suppress
from pathlib import Path
from tt_core.priority import set_nice

def session_priority():
    # The file is missing in a kernel without autogroup, and empty where control groups share out the processor instead.
    with suppress(FileNotFoundError, IndexError):
        return Path("/proc/self/autogroup").read_text().split()[-1]

before = session_priority()
set_nice(7)
print(before, session_priority(), os.getpriority(os.PRIO_PROCESS, 0))
"""


@pytest.mark.parametrize("leads", [True, False])
def test_the_nice_value_of_a_session_is_that_of_its_leader(leads):
    done = subprocess.run([sys.executable, "-c", PROGRAM], start_new_session=leads, capture_output=True, text=True, check=True)
    before, after, own = done.stdout.split()
    assert own == "7"
    assert after == ("7" if leads and before != "None" else before)


LOW = "import time; from tt_core.priority import set_nice; set_nice(7); print(flush=True); time.sleep(60)"


def test_the_nice_value_of_another_process_can_be_reset():
    with subprocess.Popen([sys.executable, "-c", LOW], start_new_session=True, stdout=subprocess.PIPE) as low:
        low.stdout.readline()
        session = Path(f"/proc/{low.pid}/autogroup")
        told = session.exists() and session.read_text().split()[-1:] == ["7"]
        reset_nice(low.pid)
        assert not told or session.read_text().split()[-1:] == ["0"]
        after = os.getpriority(os.PRIO_PROCESS, low.pid)
        try:
            os.setpriority(os.PRIO_PROCESS, low.pid, 0)
        except PermissionError:
            assert after == 7
        else:
            assert after == 0
        low.kill()
    reset_nice(low.pid)  # does nothing for a process that has ended


REALTIME = """
import os, threading
from tt_core.priority import set_nice, set_realtime, set_thread_realtime

def urgent():
    set_thread_realtime(3)
    urgent_is_set.set()
    end.wait()

urgent_is_set, end = threading.Event(), threading.Event()
threads = [threading.Thread(target=urgent), threading.Thread(target=end.wait)]
for thread in threads:
    thread.start()
urgent_is_set.wait()
set_realtime(5)
print(*(os.sched_getparam(thread.native_id).sched_priority for thread in [threading.main_thread(), *threads]))
set_nice(1)
print(os.sched_getscheduler(0) == os.SCHED_OTHER)
end.set()
"""


def test_real_time_priorities_are_for_the_threads_that_have_none():
    done = subprocess.run([sys.executable, "-c", REALTIME], capture_output=True, text=True)
    if "PermissionError" in done.stderr:
        pytest.skip("this machine does not permit real-time priorities (ulimit -r)")
    assert done.stdout.splitlines() == ["5 3 5", "True"], done.stderr
