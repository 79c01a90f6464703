"""Restart of a process after a standstill, because other nodes may have lost it."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import yaml
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from ..start import SIGNALS

CHECK_INTERVAL = 0.25  # s between two checks
LONGEST_STANDSTILL = 1.5  # s; DDS removes a participant after 2 s without a message, and each sends one every 0.3 s
BUSY_SHARE = 0.3  # of that time; a process that computes for a larger share does not stand still
MOST_FILES = 4096  # file descriptors below this number are closed before the new program starts; a node has about 200


def watch_standstill(node: Node, stood_still: Callable[[float], None]) -> None:
    """Call a function when the process has stood still for longer than LONGEST_STANDSTILL, as after SIGSTOP or without a free core.

    Args:
        node: A node that is spun at once.
        stood_still: It receives the duration of the standstill, s.
    """
    last = time.monotonic(), time.process_time()  # s, at the last check

    def check() -> None:
        nonlocal last
        now = time.monotonic(), time.process_time()
        passed, computed = (new - old for new, old in zip(now, last, strict=True))
        last = now
        if passed > LONGEST_STANDSTILL and computed < BUSY_SHARE * passed:
            stood_still(passed)

    node.create_timer(CHECK_INTERVAL, check, clock=Clock(clock_type=ClockType.STEADY_TIME))


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
