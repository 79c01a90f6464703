"""Predicting the landings of real launches: gravity only, the models as printed, and C_D identified on the other half of the launches."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
from report import arguments, report
from rich.console import Console
from rich.table import Table
from tt_predict.recordings import aimy
from tt_predict.validate import COMPARED_MODELS, SEEN_DURATION, validate


def main() -> None:
    args = arguments("identify", 1)
    folder = os.environ.get("TT_DATA_DIR")
    if not folder:
        sys.exit("identify: TT_DATA_DIR does not name the folder of the recorded launches")
    flights = aimy(Path(folder) / "aimy")
    errors, metrics = validate(flights), {}
    table = Table(
        "launches",
        "model",
        "balls",
        "place, m",
        "",
        "time, ms",
        "",
        title=f"landing errors, median and 90th percentile, {SEEN_DURATION} s seen",
    )
    for (group, name), pairs in errors.items():
        if len(pairs) == 0:
            continue
        (place, time), (far, late) = np.percentile(pairs, [50, 90], axis=0)
        table.add_row(group, name, str(len(pairs)), f"{place:.3f}", f"{far:.3f}", f"{1e3 * time:.1f}", f"{1e3 * late:.1f}")
    for name in COMPARED_MODELS:
        pairs = np.concatenate([errors[key] for key in errors if key[1] == name])
        (place, time), (far, late) = np.percentile(pairs, [50, 90], axis=0)
        metrics |= {f"{name}: place, median, m": place, f"{name}: place, 90 %, m": far}
        metrics |= {f"{name}: time, median, ms": 1e3 * time, f"{name}: time, 90 %, ms": 1e3 * late}
    Console(width=120).print(table)
    report("identify", len(flights), metrics, args.json)


if __name__ == "__main__":
    main()
