"""Restart of a process after a standstill, because other nodes may have lost it."""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import yaml
from rclpy.node import Node

from ..start import SIGNALS

CHECK_INTERVAL = 0.25  # s between two checks
LONGEST_STANDSTILL = 1.5  # s; DDS removes a participant after 2 s without a message, and each sends one every 0.3 s
BUSY_SHARE = 0.3  # of that time; a process that computes for a larger share does not stand still
MOST_FILES = 4096  # file descriptors below this number are closed before the new program starts; a node has about 200


@contextmanager
def watch_standstill(stood_still: Callable[[float], None]) -> Iterator[None]:
    """While the context is entered, watch whether the process stands still, as after SIGSTOP or without a free core.

    A thread watches, not the executor of the node, which a long callback holds up while the threads of DDS go on.

    Args:
        stood_still: Called by the thread after a standstill longer than LONGEST_STANDSTILL. It receives the duration, s.
    """
    left, last = threading.Event(), (time.monotonic(), time.process_time())  # s, at the last check

    def watch() -> None:
        nonlocal last
        while not left.wait(CHECK_INTERVAL):
            now = time.monotonic(), time.process_time()
            passed, computed = (new - old for new, old in zip(now, last, strict=True))
            last = now
            if passed > LONGEST_STANDSTILL and computed < BUSY_SHARE * passed:
                stood_still(passed)

    threading.Thread(target=watch, name="standstill", daemon=True).start()
    try:
        yield
    finally:
        left.set()


def changeable_parameters(node: Node) -> dict[str, Any]:
    """Return the present values of the parameters that can be changed at run time, by name.

    Parameters that are not set and empty lists are left out, because they cannot be given on the command line.

    Args:
        node: The node that has the parameters.
    """
    names = list(node.get_parameters_by_prefix(""))
    read_only = [descriptor.read_only for descriptor in node.describe_parameters(names)]
    values = [parameter.value for parameter in node.get_parameters(names)]
    plain = [list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value for value in values]
    return {name: value for name, value, fixed in zip(names, plain, read_only, strict=True) if not fixed and value not in (None, [])}


def restart(parameters: Mapping[str, Any]) -> None:
    """Start the program of this process from its beginning, in the same process and with the same command. This does not return.

    Args:
        parameters: Values by name. They are added to the command and override the values that are given there.
    """
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={yaml.safe_dump(value, default_flow_style=True, width=math.inf).splitlines()[0]}"]
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # the new process unblocks them when it can answer, see `tt_core.start`
    os.closerange(3, MOST_FILES)  # sockets that DDS has left open would stay open in the new program
    os.execv(sys.executable, [*sys.orig_argv, *arguments])
