"""Read single keys from the terminal, without waiting for Enter."""

from __future__ import annotations

import os
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

KEY_SEQUENCES = {b" ": "space", b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left"}
HELP = "keys: space pauses and goes on, right plays the next message, left goes 1 s back, up and down change the rate by 10 %"


def attached() -> bool:
    """Return whether standard input is a terminal and this process is in its foreground, so that it gets the keys."""
    with suppress(OSError, ValueError):
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    return False


@contextmanager
def keyboard() -> Iterator[int]:
    """Let the terminal pass on each key at once within this context, and yield its file descriptor."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def read_key(descriptor: int) -> str | None:
    """Read a pressed key and return its name, a value of KEY_SEQUENCES; None for any other key. descriptor: of the terminal."""
    return KEY_SEQUENCES.get(os.read(descriptor, 8))
