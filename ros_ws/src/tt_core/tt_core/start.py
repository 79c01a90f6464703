"""Entry point of a node's process: `python -m tt_core.start MODULE ARGUMENTS`, or the function `start` in the executables."""

from __future__ import annotations

import ast
import gc
import importlib
import importlib.util
import signal
import sys
from pathlib import Path

from .shared_memory import check_room, remove_leftovers

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def default_signals() -> None:
    """Let SIGINT and SIGTERM end the process at once, without KeyboardInterrupt."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def print_help(module: str) -> None:
    """Print the docstring of a node's module, and how the node takes parameters. The module is not imported."""
    name = module.rpartition(".")[2]
    spec = importlib.util.find_spec(module)
    assert spec is not None and spec.origin is not None
    print(f"usage: {name} [--ros-args [-p NAME:=VALUE] [-r OLD:=NEW] [--params-file FILE] [--log-level LEVEL]]\n")
    print(ast.get_docstring(ast.parse(Path(spec.origin).read_text())))  # without importing it, which takes a second
    print("Parameters: docs/parameters.md; of a running node: ros2 param describe NODE NAME")


def start(module: str) -> None:
    """Import `module`, call its main() and exit.

    The executables start Python with SIGINT blocked (`env --block-signal=INT`), because an interpreter that starts or imports answers it
    with a traceback, with exit code 1, or not at all. It takes effect here.

    A file or folder that cannot be read or written (OSError) ends the process with one line and exit code 2.

    Args:
        module: Name of a module with a function `main`.
    """
    default_signals()
    remove_leftovers()
    check_room()
    if module.endswith("_node") and not {"-h", "--help"}.isdisjoint(sys.argv[1:]):
        print_help(module)
        return
    gc.disable()  # what imports make is never garbage, but searching it again and again takes an eighth of their time
    main = importlib.import_module(module).main
    gc.freeze()
    gc.enable()
    try:
        sys.exit(main())
    except OSError as error:
        print(": ".join(str(part) for part in (error.filename, error.strerror or error) if part), file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    start(sys.argv.pop(1))
