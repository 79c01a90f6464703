"""Arms side by side: what each returns, and what limits it. scripts/bench arm_table

Ours are played as they come. Foreign ones are the URDFs of the PyPI package `example-robot-data`, from the folder that the environment
variable EXAMPLE_ROBOT_DATA names or, if it is installed, from the package (pip install --no-deps example-robot-data); where they stand is
searched first. Balls are the catapult's of scales 3 to 5 in the worlds `liu` and `real`, its scales 6 to 10 by bands of spin, and shots of
real play (TT_DATA_DIR).
"""

from __future__ import annotations

import importlib.metadata
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from report import arguments, report
from rich.console import Console
from rich.table import Table
from tt_core.constants import RPM
from tt_core.robots import ArmFile, robots
from tt_eval.arm_study.arm_page import shares
from tt_eval.arm_study.limiting import limiting
from tt_eval.arm_study.main import write_folder
from tt_eval.arm_study.search import SearchTask, search_placements
from tt_eval.evaluate import Sweep
from tt_eval.scenario import load
from tt_eval.sweep import sweep

FOREIGN = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "Panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "Kinova Jaco 2": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
}
CANDIDATES = 300  # placements that are tried for a foreign arm
WORLDS = ("liu", "real", "rallies", "fastest")
BANDS = ((0.0, 400.0), (400.0, 600.0), (600.0, np.inf))  # rad/s


def foreign(folder: Path) -> dict[str, str]:
    """Search where each foreign arm should stand; its folder by name."""
    given = os.environ.get("EXAMPLE_ROBOT_DATA")
    try:
        installed = [] if given else importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        print("example-robot-data is not installed: our arms only")
        return {}
    found = {}
    for name, (path, tip) in FOREIGN.items():
        urdf = Path(given) / path if given else next(Path(str(file.locate())) for file in installed if file.as_posix().endswith(path))
        arm, out = ArmFile(urdf=str(urdf.resolve()), tip=tip), folder / name
        tried = search_placements(SearchTask(arm.urdf, arm, count=CANDIDATES), out / "search.jsonl", report=print)
        write_folder(out, arm, urdf.resolve(), max(tried, key=lambda one: one.value(0.5)))
        found[name] = str(out)
    return found


def main() -> None:
    args, metrics = arguments("arm_table", 1000), dict[str, float]()
    table = Table("arm", "balls", "hit, %", "on the table, %", "landing, cm", "most is limited by", title=f"{args.runs} balls each")
    with tempfile.TemporaryDirectory() as made:
        for name, arm in ({name: name for name in robots()} | foreign(Path(made))).items():
            for world in WORLDS:
                out = Path(made) / "balls.parquet"
                sweep(replace(load(world, images=False), arm=arm, name=f"{name} {world}"), args.runs, out)
                played = Sweep.read(out)
                _, hit, landed, off = shares(played)
                for limit, count in list(limiting(played.limits).items())[:1] or [("nothing", 0)]:
                    table.add_row(name, world, f"{hit:.1f}", f"{landed:.1f}", f"{off:.1f}", f"{limit} ({100.0 * count / args.runs:.1f} %)")
                metrics |= {f"{name}, {world}: hit, %": hit, f"{name}, {world}: on the table, %": landed}
                metrics[f"{name}, {world}: landing off, cm"] = off
                if world == "fastest":
                    spin = played.numbers["spin_rpm"] * RPM
                    for low, high in BANDS:
                        band = (spin >= low) & (spin < high)
                        if band.any():
                            metrics[f"{name}, spin {low:g} to {high:g} rad/s: on the table, %"] = shares(played, band)[2]
                            metrics[f"{name}, spin {low:g} to {high:g} rad/s: balls"] = float(band.sum())
    Console().print(table)
    report("arm_table", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
