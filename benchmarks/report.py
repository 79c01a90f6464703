"""What every benchmark prints and writes: a table for people, and {"name", "machine", "runs", "metrics"} for --json."""

from __future__ import annotations

import argparse
import json
import os
import platform
from pathlib import Path

from rich.console import Console
from rich.table import Table


def arguments(name: str, runs: int, seed: int | None = None) -> argparse.Namespace:
    """--json FILE, --runs N and, with a default, --seed N; a benchmark reads them from the result."""
    parser = argparse.ArgumentParser(prog=f"scripts/bench {name}")
    parser.add_argument("--json", type=Path, help="write the metrics here")
    parser.add_argument("--runs", type=int, default=runs, help=f"trials (default {runs})")
    if seed is not None:
        parser.add_argument("--seed", type=int, default=seed, help=f"of all that is drawn (default {seed})")
    return parser.parse_args()


def report(name: str, runs: int, metrics: dict[str, float], path: Path | None) -> None:
    table = Table("metric", "value", title=f"{name}, {runs} runs")
    for key, value in metrics.items():
        table.add_row(key, f"{value:.4g}")
    Console().print(table)
    if path:
        machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
        path.write_text(json.dumps({"name": name, "machine": machine, "runs": runs, "metrics": metrics}, indent=1) + "\n")
