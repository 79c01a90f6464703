"""Scheduling priority of a process under Linux."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

TASKS = Path("/proc/self/task")  # the threads of this process


@dataclass(frozen=True)
class Priority:
    """Scheduling priority that a process asks for.

    A thread with a real-time priority runs at once on any core on which nothing as urgent runs, and other programs do not interrupt it.
    Processes without a real-time priority share the cores in slices of time: one that is interrupted after each millisecond, and moved from
    core to core, takes twice as long.

    Attributes:
        realtime: Level of SCHED_FIFO, 1 to 99; 0 for no real-time priority.
        nice: Nice value where real-time priorities are not permitted, from -20, the most urgent, to 19.
    """

    realtime: int = 0
    nice: int = 0


ORDINARY = Priority()
CONTROL = Priority(20, -10)  # arm and hardware: short work at fixed times
RESPONSE = Priority(15, -5)  # camera, tracker, prediction, strokes: short work, needed while the ball is in flight
MEASUREMENT = Priority(10, -5)  # long work, needed while the ball is in flight
IMPROVEMENT = Priority(5, 0)  # long work that only improves a result which is there already


def set_nice(nice: int) -> None:
    """Set the nice value of this process, of the threads that it starts from now on, and of its session if it leads one.

    Linux shares the processor between sessions first (autogroup, man 7 sched): the nice value of a process counts within its session only.
    A process that a launch file has started leads a session of its own. A real-time priority that this process has inherited is removed.

    Args:
        nice: From -20, the most urgent, to 19.

    Raises:
        PermissionError: A negative value is not permitted (ulimit -e).
    """
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.setpriority(os.PRIO_PROCESS, 0, nice)
    if os.getsid(0) == os.getpid():
        with suppress(OSError):  # a kernel without autogroup, or one that lets nobody change it: then processes compete one by one
            Path("/proc/self/autogroup").write_text(str(nice))


def reset_nice(pid: int) -> None:
    """Set the nice value of another process of this user, and of the session that it leads, back to 0, as far as the system permits it.

    Any user may reset the nice value of a session. That of a process takes a permission (ulimit -e); without it the value stays as it is.

    Args:
        pid: Number of the process.
    """
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text("0")
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, 0)


def set_realtime(level: int) -> None:
    """Give a real-time priority to all threads of this process that have none yet.

    Threads that are started later inherit the priority of the thread that starts them.

    Args:
        level: Level of SCHED_FIFO, 1 to 99.

    Raises:
        PermissionError: This level is not permitted (ulimit -r).
    """
    for task in TASKS.iterdir():
        with suppress(ProcessLookupError):  # a thread that has ended meanwhile
            if os.sched_getscheduler(int(task.name)) == os.SCHED_OTHER:
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(level))


def set_thread_realtime(level: int) -> None:
    """Give the calling thread a real-time priority; do nothing if that is not permitted.

    Args:
        level: Level of SCHED_FIFO, 1 to 99.
    """
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(level))
