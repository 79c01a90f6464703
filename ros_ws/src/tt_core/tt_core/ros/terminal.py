"""Lines that a node writes to the terminal and to /rosout. A thread writes them, so a terminal that blocks does not delay the node."""

from __future__ import annotations

import queue
import threading
import time
from enum import Enum
from typing import Any

from rclpy.node import Node

WAITING = 100  # most lines that wait to be written; further lines are left out and counted
WARNING_INTERVAL = 1.0  # s, least time between two warnings of one code


class Terminal:
    """Writes lines through the logger of a node.

    A line is a member of an enumeration whose values are format strings, like the codes of `tt_core.failures.Failure`. So all texts of a
    node stand in one place, and no code decides on texts.
    """

    def __init__(self, node: Node) -> None:
        """Start the thread that writes; it ends with the context of the node."""
        self._node = node
        self._queue: queue.Queue[tuple[bool, str] | None] = queue.Queue(WAITING)
        self._left_out = 0
        self._warned: dict[Enum, float] = {}  # s, when each code was told last
        threading.Thread(target=self._run, name="terminal", daemon=True).start()
        node.context.on_shutdown(self._end)

    def info(self, line: Enum, **values: Any) -> None:
        """Write a line.

        Args:
            line: Member of an enumeration whose value is a format string.
            values: Values for the format string, by name.
        """
        self._put(False, str(line.value).format(**values))

    def warn(self, line: Enum, **values: Any) -> None:
        """Write a warning, at most one of each member in WARNING_INTERVAL.

        Args:
            line: Member of an enumeration whose value is a format string.
            values: Values for the format string, by name.
        """
        now = time.monotonic()
        if now >= self._warned.get(line, -WARNING_INTERVAL) + WARNING_INTERVAL:
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
