"""Keys of the terminal, read one by one without Enter."""

from __future__ import annotations

import os
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

SEQUENCES = {b" ": "space", b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left"}
HELP = "keys: space pauses and goes on, right plays the next message, left goes 1 s back, up and down change the rate by 10 %"


def attached() -> bool:
    """Tell whether there is a terminal, and this process is the one that it listens to."""
    with suppress(OSError, ValueError):
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    return False


@contextmanager
def keyboard() -> Iterator[int]:
    """Let the terminal give each key at once, and yield its file descriptor."""
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def read_key(descriptor: int) -> str | None:
    """Return the name of a key that was pressed, None for one without a meaning here."""
    return SEQUENCES.get(os.read(descriptor, 8))
