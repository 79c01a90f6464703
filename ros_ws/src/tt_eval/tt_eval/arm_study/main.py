"""Find out whether an arm can play, and where it should stand: ros2 run tt_eval arm my.urdf --tip tool0.

Searches base, mount and waiting posture, plays balls of the catapult and shots of real play in the world real, and writes a folder that
`robot:=` takes: arm file, URDF, the balls, and a page. An interrupted run continues where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import sys
from dataclasses import asdict, fields, replace
from pathlib import Path

import rich.table
import yaml
from rich.console import Console
from tt_core.errors import TtError
from tt_core.hit_windows import HIT_WINDOWS
from tt_core.robots import ARM_FILE, ArmFile, read_arm
from tt_sim.world.launcher import SCALES

from ..evaluate import Sweep
from ..page import write_page
from ..scenario import Scenario, load
from ..sweep import sweep
from .arm_page import Study, arm_summary, limits_table, placement_table, score_table, study_page
from .placement import PLACEMENT_PARTS
from .search import Candidate, SearchTask, search_placements
from .speed_map import speed_map

SEARCH_FILE, REPORT_FILE = "search.jsonl", "report.html"  # in the folder that is written


def given_arm(arm: str, tip: str | None, window: str | None) -> tuple[ArmFile, Path]:
    """Return the arm file and the URDF for the arguments of the command.

    Args:
        arm: Path of a URDF; or a name, an arm file or a folder, as for `robot:=`.
        tip: Link that the racket is mounted on, instead of that of the file.
        window: Name in HIT_WINDOWS of the region in which the arm hits balls, instead of that of the file.

    Raises:
        TtError: There is no such file, or a value in it is wrong.
    """
    if Path(arm).suffix in (".urdf", ".xml"):
        found, urdf = ArmFile(urdf=str(Path(arm).resolve())), Path(arm).resolve()
    else:
        found, urdf = read_arm(arm)
    if tip is not None:
        found = replace(found, tip=tip)
    return (replace(found, hit_window=HIT_WINDOWS[window]) if window else found), urdf.resolve()


def write_folder(folder: Path, arm: ArmFile, urdf: Path, best: Candidate) -> ArmFile:
    """Write the arm file of a placement to a folder, and the URDF.

    A URDF with meshes is not copied, because their paths may be relative to it.

    Args:
        folder: The folder, which exists.
        arm: Arm file of the arm as it was given.
        urdf: Path of the URDF.
        best: The placement.

    Returns:
        The content of the written arm file.
    """
    has_meshes = "<mesh" in urdf.read_text(errors="replace")
    if not has_meshes and urdf != (folder / urdf.name).resolve():
        shutil.copyfile(urdf, folder / urdf.name)
    placed = replace(arm, urdf=str(urdf) if has_meshes else urdf.name, **asdict(best.placement))
    content = {f.name: getattr(placed, f.name) for f in fields(placed) if getattr(placed, f.name) != f.default}
    content = {name: asdict(value) if name == "hit_window" else value for name, value in content.items() if value not in (None, {}, ())}
    listed = {name: list(value) if isinstance(value, tuple) else value for name, value in content.items()}
    text = yaml.safe_dump(listed, sort_keys=False, default_flow_style=None, width=140)
    (folder / ARM_FILE).write_text(f"# Written by `ros2 run tt_eval arm`: the placement with which this arm plays best\n{text}")
    return placed


def played(folder: Path, name: str, scenario: Scenario, balls: int, workers: int | None) -> Sweep:
    """Simulate a sweep with the arm of a folder; continue it if it was interrupted, or read it if it is complete.

    Args:
        folder: Folder with the arm file, to which the sweep is written.
        name: Name of the sweep.
        scenario: The scenario, whose arm is replaced.
        balls: Number of balls.
        workers: Number of processes; None: one for each core.

    Returns:
        The results.
    """
    mark = hashlib.sha256((folder / ARM_FILE).read_bytes()).hexdigest()[:8]  # another placement is another sweep
    out = folder / f"{name}_{mark}_{balls}.parquet"
    if not out.is_file():
        print(f"{balls} balls: {name}", file=sys.stderr, flush=True)
        sweep(replace(scenario, arm=str(folder), name=f"{name} {mark}"), balls, out, workers=workers)
    return Sweep.read(out)


def study(args: argparse.Namespace) -> Study:
    """Search the best placement of an arm, simulate balls with it, and return the results."""
    arm, urdf = given_arm(args.arm, args.tip, args.window)
    folder: Path = args.out
    task = SearchTask(str(urdf), arm, tuple(args.keep), args.weight, args.candidates)
    found = search_placements(task, folder / SEARCH_FILE, args.workers, lambda line: print(line, file=sys.stderr, flush=True))
    best = max(found[: max(1, args.candidates)], key=lambda one: one.value(args.weight))
    placed = write_folder(folder, arm, urdf, best)
    every = tuple(range(SCALES[0], SCALES[1] + 1))
    catapult = replace(load("real", images=False), scale=every)
    model = best.placement.model(str(urdf), arm)
    return Study(
        folder.resolve().name,
        best,
        found,
        played(folder, "catapult", catapult, len(every) * args.balls, args.workers),
        played(folder, "rallies", load("rallies", images=False), args.balls, args.workers),
        speed_map(model, placed.hit_window, placed.command_timeout),
    )


def arguments() -> argparse.Namespace:
    """Read and check the arguments of the command."""
    parser = argparse.ArgumentParser(prog="arm", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arm", help="a URDF; or the name of an arm, an arm file, or its folder")
    parser.add_argument("--tip", help="link that the racket is mounted on")
    parser.add_argument("--out", type=Path, metavar="DIR", help="the folder that is written (default out/arms/NAME)")
    parser.add_argument("--candidates", type=int, default=300, metavar="N", help="placements to try (default 300); 1: only the given one")
    parser.add_argument("--balls", type=int, default=1000, metavar="N", help="of each scale, and of real play (default 1000)")
    parser.add_argument("--keep", nargs="*", default=[], choices=PLACEMENT_PARTS, help="what of the placement is not varied")
    parser.add_argument("--weight", type=float, default=0.5, metavar="W", help="of real play against the catapult, 0 to 1 (default 0.5)")
    parser.add_argument("--window", choices=tuple(HIT_WINDOWS), help="hit window instead of that of the arm file")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: one for each core)")
    args = parser.parse_args()
    for name, least in (("candidates", 1), ("balls", 1), ("workers", 1)):
        value = getattr(args, name)
        if value is not None and value < least:
            parser.error(f"--{name} {value} is less than {least}")
    if not 0.0 <= args.weight <= 1.0:
        parser.error(f"--weight {args.weight:g} is outside [0, 1]")
    stem = Path(args.arm).parent.name if Path(args.arm).name == ARM_FILE else Path(args.arm).stem
    args.out = args.out or Path("out") / "arms" / stem
    return args


def main() -> None:
    """Run the command arm."""
    args = arguments()
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        done = study(args)
        write_page(args.out / REPORT_FILE, study_page(done))
    except (TtError, OSError) as error:
        print(f"arm: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print(f"arm: interrupted; the same command goes on with what is in {args.out}", file=sys.stderr)
        raise SystemExit(130) from None
    console = Console()
    for table in (score_table(done), limits_table(done), placement_table(done)):
        printed = rich.table.Table(*table.head, title=table.title, title_justify="left")
        for row in table.rows:
            printed.add_row(*row)
        console.print(printed)
    for sentence in arm_summary(done):
        console.print(sentence, highlight=False)
    print(f"arm file: {args.out / ARM_FILE}    robot:={args.out}\nfigures:  {args.out / REPORT_FILE}")


if __name__ == "__main__":
    main()
