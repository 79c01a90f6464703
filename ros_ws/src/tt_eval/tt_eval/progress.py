"""Progress of a long computation on stderr: a bar in a terminal, elsewhere a line for each tenth."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

T = TypeVar("T")

PROGRESS_COLUMNS = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()


@contextmanager
def progress(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Show the progress of a computation while the context lasts.

    Args:
        what: What is counted, e.g. "balls".
        total: How many there are.
        done: How many are done already.

    Yields:
        A function to be called with the number of items that were done since its last call.
    """
    with Progress(*PROGRESS_COLUMNS, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        row = bar.add_task(what, total=total, completed=done)

        def advance(more: int) -> None:
            nonlocal done
            before, done = done, done + more
            bar.advance(row, more)
            if bar.disable and 10 * done // total > 10 * before // total:
                print(f"{done} of {total} {what}", file=sys.stderr, flush=True)

        yield advance


def tracked(what: str, total: int, items: Iterable[T]) -> Iterator[T]:
    """Yield the given items, and show how many of them are done.

    Args:
        what: What is counted, e.g. "balls".
        total: Number of the items.
        items: The items.
    """
    with progress(what, total) as advance:
        for item in items:
            yield item
            advance(1)
