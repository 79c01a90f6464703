"""Find where an arm stands and how it holds its racket: ros2 run tt_bringup locate --robot pa10 --touches touches.csv.

Move the arm by hand or by its driver. Touch known places of the table with known points of the racket, or let calibrated cameras see known
points of it or a chess board on its face. Write a row for each. The result is a parameter file for `more_params_file:=`, with residuals.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml
from rich.console import Console
from rich.table import Table
from tt_arm.arm_file import load_arm
from tt_arm.arm_urdf.urdf import RACKET_LINK
from tt_arm.model import ArmModel, mount_placement
from tt_core.errors import TtError
from tt_core.robots import DEFAULT_ROBOT, ArmFile, read_arm
from tt_core.states import Array

from .fit import FITTED_PARTS, Located, fit_placement, upright
from .observations import read_board_images, read_cameras, read_sightings, read_touches


def six(placement: pin.SE3) -> list[float]:
    """Return a pose as six numbers, as parameters have it: x, y, z (m), roll, pitch and yaw (rad)."""
    return [round(float(value), 9) for value in (*placement.translation, *pin.rpy.matrixToRpy(placement.rotation))]


def believed_mount(arm: ArmModel, given: ArmFile) -> pin.SE3:
    """Return the pose of the racket on the arm's tip as it is assumed before the fit: the value of the key `mount` of the arm file.

    Args:
        arm: The arm at its assumed place.
        given: The arm file. If it has no `mount`, the pose is that of the racket in the URDF.
    """
    if given.mount is not None:
        return mount_placement(given.mount)
    if given.tip in (None, RACKET_LINK):  # the mount is then relative to the racket of the URDF
        return pin.SE3.Identity()
    tip, racket = (arm.pinocchio.frames[arm.pinocchio.getFrameId(name, pin.FrameType.BODY)].placement for name in (given.tip, RACKET_LINK))
    return tip.inverse() * racket


def parameter_text(arm: ArmModel, given: ArmFile, located: Located) -> str:
    """Return the text of a parameter file (YAML) for the node arm, with the base and mount that were fitted.

    Args:
        arm: The arm at its assumed place.
        given: Its arm file.
        located: Result of the fit.
    """
    values = {"base": six(located.base * arm.base), "mount": six(believed_mount(arm, given) * located.mount)}
    kept = {name: values[name] for name in FITTED_PARTS if name in located.sigma}
    text = yaml.safe_dump({"/**/arm": {"ros__parameters": kept}}, sort_keys=False, default_flow_style=None, width=140)
    return f"# Written by `ros2 run tt_bringup locate`; give it to launch files as more_params_file\n{text}"


def result_tables(located: Located) -> list[Table]:
    """Return the tables for the terminal: residuals of the observations, and corrections with their standard deviations."""
    residuals = Table("observations", "count", "rms", "worst", "row of the worst", title="Residuals", title_justify="left")
    for name, unit, values, scale in (("touched places", "mm", located.touched, 1e3), ("seen points", "pixels", located.seen, 1.0)):
        if len(values):
            rms = scale * float(np.sqrt(np.mean(values**2)))
            residuals.add_row(
                name, str(len(values)), f"{rms:.2f} {unit}", f"{scale * values.max():.2f} {unit}", str(int(values.argmax()) + 1)
            )
    found = Table("what", "moved by, mm", "sigma, mm", "turned by, deg", "sigma, deg", title="Corrections", title_justify="left")
    for part, moved in (("base", located.base), ("mount", located.mount)):
        if part in located.sigma:
            turn, sigma = np.degrees(pin.log3(moved.rotation)), located.sigma[part]
            found.add_row(part, *map(_cells, (1e3 * moved.translation, 1e3 * sigma[:3], turn, np.degrees(sigma[3:]))))
    return [residuals, found]


def _cells(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line; an invalid one ends the process with a message. words: its arguments; those of the process if None."""
    parser = argparse.ArgumentParser(prog="locate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--robot", default=DEFAULT_ROBOT, help=f"an arm, by name, arm file or folder, where it nearly stands (default {DEFAULT_ROBOT})"
    )
    parser.add_argument("--touches", type=Path, metavar="CSV", help="rows: joint positions, x, y, z touched, px, py, pz of the racket")
    parser.add_argument("--pixels", type=Path, metavar="CSV", help="rows: joint positions, camera (left or right), u, v, px, py, pz")
    parser.add_argument("--images", type=Path, metavar="CSV", help="rows: joint positions, camera, image of a chess board on the face")
    parser.add_argument("--board", nargs=2, type=int, default=(4, 3), metavar=("N", "M"), help="its inner corners (default 4 3)")
    parser.add_argument("--square", type=float, default=0.02, metavar="S", help="side of its squares, m (default 0.02)")
    parser.add_argument("--cameras", type=Path, metavar="YAML", help="cameras.yaml as calibrate writes it, for --pixels and --images")
    parser.add_argument("--keep", nargs="*", default=[], choices=FITTED_PARTS, help="what is known already")
    parser.add_argument("--out", type=Path, default=Path("place.yaml"), metavar="FILE", help="parameter file (default place.yaml)")
    args = parser.parse_args(words)
    if not (args.touches or args.pixels or args.images):
        parser.error("nothing is observed: give --touches, --pixels or --images")
    if (args.pixels or args.images) and not args.cameras:
        parser.error("--pixels and --images need --cameras")
    return args


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line: fit, print residuals and corrections, write the parameter file. words: as `arguments` takes them."""
    args = arguments(words)
    try:
        arm, (given, _) = load_arm(args.robot), read_arm(args.robot)
        joints = len(arm.names)
        touches = read_touches(args.touches, joints) if args.touches else []
        sightings = read_sightings(args.pixels, joints) if args.pixels else []
        cameras = read_cameras(args.cameras) if args.cameras else {}
        for board in read_board_images(args.images, joints, tuple(args.board), args.square) if args.images else ():
            sightings += upright(arm, board, cameras)
        located = fit_placement(arm, touches, sightings, cameras, args.keep)
        args.out.write_text(parameter_text(arm, given, located))
    except (TtError, OSError) as error:
        print(f"locate: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    for table in result_tables(located):
        Console().print(table)
    print(args.out)


if __name__ == "__main__":
    main()
