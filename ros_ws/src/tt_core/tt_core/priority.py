"""The scheduling priority of a process."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def set_priority(nice: int) -> None:
    """Set the priority of this process, of the threads that it starts from now on, and of its session if it leads one.

    Linux shares the processor between sessions first (autogroup, man 7 sched): the nice value of a process counts within its session only.
    A process that a launch file has started leads a session of its own.

    Args:
        nice: -20, the most urgent, to 19.

    Raises:
        PermissionError: A negative value is not permitted (ulimit -e).
    """
    os.setpriority(os.PRIO_PROCESS, 0, nice)
    if os.getsid(0) == os.getpid():
        with suppress(OSError):  # a kernel without autogroup, or one that lets nobody change it: then processes compete one by one
            Path("/proc/self/autogroup").write_text(str(nice))
