"""What a node tells in the terminal and on /rosout, by a thread of its own: a terminal that is full or stopped holds nothing up."""

from __future__ import annotations

import queue
import threading
import time
from enum import Enum
from typing import Any

from rclpy.node import Node

WAITING = 100  # lines that may wait; what is beyond is left out and counted
INTERVAL = 1.0  # s, at least, between two warnings of one code


class Terminal:
    """Tells lines through the logger of a node.

    A line is a member of an enumeration whose values are format strings, as the codes of `tt_core.failures.Failure`. So the words of a node
    stand in one place, and no code decides on them.
    """

    def __init__(self, node: Node) -> None:
        """Begin; it ends with the context of the node."""
        self._node = node
        self._queue: queue.Queue[tuple[bool, str] | None] = queue.Queue(WAITING)
        self._left_out = 0
        self._warned: dict[Enum, float] = {}  # s, when each code was told last
        threading.Thread(target=self._run, name="terminal", daemon=True).start()
        node.context.on_shutdown(self._end)

    def info(self, line: Enum, **values: Any) -> None:
        """Tell a line. values: What its format string needs."""
        self._put(False, str(line.value).format(**values))

    def warn(self, line: Enum, **values: Any) -> None:
        """Tell a warning, at most one of each code in INTERVAL. values: What its format string needs."""
        now = time.monotonic()
        if now >= self._warned.get(line, -INTERVAL) + INTERVAL:
            self._warned[line] = now
            self._put(True, str(line.value).format(**values))

    def _put(self, is_warning: bool, text: str) -> None:
        try:
            self._queue.put_nowait((is_warning, text))
        except queue.Full:
            self._left_out += 1

    def _end(self) -> None:
        while True:
            try:
                self._queue.put_nowait(None)
                return
            except queue.Full:
                self._queue.get_nowait()

    def _run(self) -> None:
        logger = self._node.get_logger()
        while (item := self._queue.get()) is not None:
            is_warning, text = item
            left_out, self._left_out = self._left_out, 0
            text += f" ({left_out} lines left out)" if left_out else ""
            if is_warning:
                logger.warning(text)
            else:
                logger.info(text)
