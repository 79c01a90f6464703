"""Worker processes on the cores of this machine, which end with the process that started them."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, parent_process
from threading import Thread


def process_pool(workers: int | None = None) -> ProcessPoolExecutor:
    """Return an executor that starts its worker processes as new Python interpreters, not as copies of this process.

    Args:
        workers: Number of processes; None: one for each core.
    """
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=_watch_parent)


def _watch_parent() -> None:
    """Start a thread that ends this process when its parent has ended. After a kill of the parent it would wait for tasks for ever."""
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait until the parent process ends, by itself or by a signal, and then end this process at once."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
