"""The first code of a node's process: `python -m tt_core.start MODULE ARGUMENTS`, or `start` in the executables."""

from __future__ import annotations

import importlib
import signal
import sys

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def default_signals() -> None:
    """Let SIGINT and SIGTERM end the process at once, without KeyboardInterrupt."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def start(module: str) -> None:
    """Import `module`, call its main() and exit.

    The executables start Python with SIGINT blocked (`env --block-signal=INT`), because an interpreter that starts or imports answers it
    with a traceback, with exit code 1, or not at all. It takes effect here.

    Args:
        module: Name of a module with a function `main`.
    """
    default_signals()
    sys.exit(importlib.import_module(module).main())


if __name__ == "__main__":
    start(sys.argv.pop(1))
