"""Simulate many balls of one scenario and write a Parquet file: ros2 run tt_eval sweep liu --balls 10000 --out run.parquet.

A ball's seed is its number, so the result does not depend on how the sweep is divided, where it runs or how often it was interrupted.
Finished parts are kept in FILE.parts until all are done, and only missing parts are simulated.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from tt_core.errors import TtError

from .episode import Trial, play, session
from .process_pool import process_pool
from .progress import progress
from .scenario import Scenario, load
from .sweep_metrics import NUMBERS, TEXTS, sweep_metrics

PART = 250  # most balls of one task
LEAST_TASKS = 40  # least number of tasks of a sweep, so that its progress is visible
CONNECT = 10.0  # s, longest time to connect to the scheduler
TASKS_AHEAD = 3  # tasks for each worker that are submitted at a time
SCHEMA = pa.schema([(name, pa.string()) for name in TEXTS] + [(name, pa.float64()) for name in NUMBERS])


class OtherSweep(TtError):
    """The folder for parts of this sweep holds parts of another one."""

    def __init__(self, folder: Path) -> None:
        """Store the folder of the parts."""
        super().__init__(f"{folder} holds parts of another sweep; remove it or write to another file")
        self.folder = folder


class NoScheduler(TtError):
    """A Dask scheduler that does not answer."""

    def __init__(self, address: str, error: OSError) -> None:
        """Store the address.

        Args:
            address: Address of the scheduler.
            error: What failed, for the message.
        """
        super().__init__(f"no Dask scheduler at {address}: {error}")
        self.address = address


def simulate_balls(scenario: Scenario, first: int, last: int) -> pa.Table:
    """Simulate the balls `first` to `last` - 1 of a scenario.

    Sessions whose balls depend on each other are simulated as a whole.

    Args:
        scenario: The scenario.
        first: Number of the first ball.
        last: Number after that of the last ball.

    Returns:
        A table with a row for each ball.
    """
    if not scenario.is_played_whole:
        return pa.Table.from_pylist([sweep_metrics(play(scenario, seed)) for seed in range(first, last)], SCHEMA)
    numbers = range(first // scenario.balls, -(-last // scenario.balls))
    played = (episode for number in numbers for episode in session(scenario, number))
    return pa.Table.from_pylist([sweep_metrics(episode) for episode in played if first <= episode.trial.seed < last], SCHEMA)


def fingerprint(scenario: Scenario, balls: int, size: int) -> str:
    """Return a hash of what determines the rows and parts of a sweep, so that only the same sweep is resumed.

    Args:
        scenario: The scenario.
        balls: Number of balls.
        size: Balls of one part.
    """
    return hashlib.sha256(repr((scenario, balls, size)).encode()).hexdigest()[:16]


def parts(scenario: Scenario, missing: list[tuple[int, int]], executor: Executor, workers: int) -> Iterator[tuple[int, pa.Table]]:
    """Simulate the missing parts of a sweep in parallel. Few are submitted at a time, so that memory stays bounded.

    Args:
        scenario: The scenario.
        missing: Numbers of the first ball, and after the last ball, of each part.
        executor: Runs the tasks.
        workers: Number of its workers.

    Yields:
        Number of the first ball, and rows, of each part when it is done.
    """
    left, running = iter(missing), dict[Future[pa.Table], int]()
    while True:
        while len(running) < TASKS_AHEAD * workers and (task := next(left, None)) is not None:
            running[executor.submit(simulate_balls, scenario, *task)] = task[0]
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future.result()


def sweep(scenario: Scenario, balls: int, out: Path, scheduler: str | None = None, workers: int | None = None, size: int = 0) -> None:
    """Simulate all balls that are not simulated yet, and write all rows to a file.

    Args:
        scenario: The scenario.
        balls: Number of balls.
        out: The Parquet file.
        scheduler: Address of a Dask scheduler; None: processes of this machine.
        workers: Number of processes; None: one for each core.
        size: Balls of one part; 0: at most PART, and at least LEAST_TASKS parts.

    Raises:
        OtherSweep: The parts beside the file are of another sweep.
        NoScheduler: The scheduler does not answer.
        TtError: The scenario has no such balls. All errors are raised before any ball is simulated.
    """
    Trial.drawn(scenario, 0)
    size = size or max(1, min(PART, balls // LEAST_TASKS))
    folder, mark = out.with_name(out.name + ".parts"), fingerprint(scenario, balls, size)
    begun = folder / "scenario.json"
    if begun.is_file() and json.loads(begun.read_text())["fingerprint"] != mark:
        raise OtherSweep(folder)
    folder.mkdir(parents=True, exist_ok=True)
    begun.write_text(json.dumps({"fingerprint": mark, "scenario": scenario.name, "balls": balls}))
    tasks = [(first, min(first + size, balls)) for first in range(0, balls, size)]
    missing = [(first, end) for first, end in tasks if not (folder / f"{first:09d}.parquet").is_file()]
    with ExitStack() as stack:
        advance = stack.enter_context(progress("balls", balls, balls - sum(last - first for first, last in missing)))
        executor, count = _executor(stack, scheduler, workers)
        for first, table in parts(scenario, missing, executor, count):
            half = folder / f"{first:09d}.half"
            pq.write_table(table, half)
            half.rename(half.with_suffix(".parquet"))  # whole or not there
            advance(table.num_rows)
    half = out.with_name(out.name + ".half")
    with pq.ParquetWriter(half, SCHEMA.with_metadata({"scenario": scenario.name, "fingerprint": mark})) as writer:
        for first, _ in tasks:
            writer.write_table(pq.read_table(folder / f"{first:09d}.parquet"))
    half.rename(out)
    shutil.rmtree(folder)


def _executor(stack: ExitStack, scheduler: str | None, workers: int | None) -> tuple[Executor, int]:
    if scheduler is None:
        workers = workers or os.cpu_count() or 1
        return stack.enter_context(process_pool(workers)), workers
    from distributed import Client

    try:
        client = stack.enter_context(Client(scheduler, timeout=CONNECT))
    except OSError as error:
        raise NoScheduler(scheduler, error) from error
    return stack.enter_context(client.get_executor(pure=False)), max(1, sum(client.nthreads().values()))


def main() -> None:
    """Run the command sweep."""
    parser = argparse.ArgumentParser(prog="sweep", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", help="a name of those here, or a YAML file")
    parser.add_argument("--balls", type=int, default=1000, metavar="N", help="default 1000")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="Parquet, a row for each ball")
    parser.add_argument("--robot", help="this robot instead of the scenario's")
    parser.add_argument("--world", help="this world instead of the scenario's")
    parser.add_argument(
        "--images", action="store_true", help="render and measure images, which is fifty times as slow as the sensor error model"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: one for each core)")
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="of a Dask cluster, whose workers have this workspace")
    args = parser.parse_args()
    for name, value in (("balls", args.balls), ("workers", args.workers)):
        if value is not None and value < 1:
            parser.error(f"--{name} {value} is less than 1")
    try:
        scenario = load(args.scenario, args.robot, args.world, images=args.images)
        sweep(scenario, args.balls, args.out, args.scheduler, args.workers)
    except TtError as error:
        print(f"sweep: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(args.out)


if __name__ == "__main__":
    main()
