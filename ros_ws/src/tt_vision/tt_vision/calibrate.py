"""Calibrate a camera from known points or from images of a board: ros2 run tt_vision calibrate points FILE | board IMAGE...

Writes NAME.yaml, which camera_info_manager reads, NAME_pose.yaml, which holds parameters of estimate_node, and NAME_residuals.png, which
shows the residuals. cameras.yaml gets the parameters of camera_node and estimate_node for this camera, beside those of the other one: it is
what launch files take as more_params_file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table
from tt_core.errors import TtError
from tt_core.states import Array

from .camera import Camera, calibrate
from .rig import PIXEL_SIZE, WIDE_SIDES

CAMERAS = "cameras.yaml"  # name of the file with the parameters of all cameras
ENLARGED = 50.0  # factor by which residuals are enlarged in the picture


class Calibrated(NamedTuple):
    """A calibrated camera, and the points from which it was calibrated.

    Attributes:
        camera: The camera.
        points: (n, 3) m in `table`, the known points.
        pixels: (n, 2) pixels, where the points were seen.
    """

    camera: Camera
    points: Array
    pixels: Array


def from_points(path: Path, args: argparse.Namespace) -> Calibrated:
    """Calibrate a camera from a text file of known points and the pixels at which they were seen.

    Args:
        path: File with one row x, y, z (m in `table`), u, v (pixels) for each point, separated by commas. # begins a comment.
        args: Options of the command.

    Raises:
        TtError: The file cannot be read, or its points do not determine a camera.
    """
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2, comments="#")
    except (OSError, ValueError) as error:
        raise TtError(f"{path}: {error}") from None
    if rows.shape[1] != 5:
        raise TtError(f"{path} has {rows.shape[1]} columns, wanted 5: x, y, z in m, u, v in pixels")
    points, pixels = rows[:, :3], rows[:, 3:]
    camera = calibrate(
        points,
        pixels,
        width=args.width,
        height=args.height,
        pixel_size=args.pixel_size,
        focal_length=args.focal_length,
        distortion=args.distortion,
        method=args.method,
    )
    return Calibrated(camera, points, pixels)


def from_board(paths: Sequence[Path], args: argparse.Namespace) -> Calibrated:
    """Calibrate a camera from images of a chess board, with OpenCV.

    The first image determines the pose of the camera. In it the board lies flat on the table, with its first inner corner at --origin, its
    rows along x and its columns along -y of `table`, in the order in which OpenCV finds the corners from above. All images together
    determine the focal length, the principal point and, if asked for, the distortion. Images that do not show the whole board are left out.

    Args:
        paths: The image files.
        args: Options of the command.

    Raises:
        TtError: A file is not an image, the images differ in size, the first one does not show the board, or fewer than three show it.
    """
    size = (args.columns, args.rows)
    grid = np.zeros((args.columns * args.rows, 3), dtype=np.float32)
    grid[:, :2] = args.square * np.mgrid[: args.columns, : args.rows].T.reshape(-1, 2) * (1, -1)
    seen, shape = [], None
    for path in track(paths, description="boards", console=Console(stderr=True)):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise TtError(f"{path} is no image")
        if shape not in (None, image.shape):
            raise TtError(f"{path} is {image.shape[1]} x {image.shape[0]} pixels, the first image is {shape[1]} x {shape[0]}")
        shape = image.shape
        found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE)
        if found:
            seen.append(corners.reshape(-1, 2))
        elif path == paths[0]:
            raise TtError(f"{path} must show the whole board of {size[0]} x {size[1]} inner corners: it gives the pose")
    if len(seen) < 3 or shape is None:
        raise TtError(f"{len(seen)} images show the board of {size[0]} x {size[1]} inner corners, 3 needed")
    flags = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    if not args.distortion:
        flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
    start = np.array([[1000.0, 0.0, (shape[1] - 1) / 2], [0.0, 1000.0, (shape[0] - 1) / 2], [0.0, 0.0, 1.0]])
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    _, matrix, lens, turns, shifts = cv2.calibrateCamera([grid] * len(seen), seen, shape[::-1], start, np.zeros(5), flags=flags)
    rotation = np.asarray(cv2.Rodrigues(turns[0])[0], dtype=np.float64)
    translation = np.asarray(shifts[0], dtype=np.float64).ravel() - rotation @ np.array(args.origin)
    inner, outer = np.asarray(matrix, dtype=np.float64), np.asarray(lens, dtype=np.float64).ravel()[:5]
    camera = Camera.from_matrix(rotation, translation, inner, shape[1], shape[0], outer, args.pixel_size)
    placed = [cv2.Rodrigues(turn)[0] @ grid.T + shift for turn, shift in zip(turns, shifts, strict=True)]  # in the camera's frame
    points = np.hstack(placed).T
    return Calibrated(camera, (points - camera.translation) @ camera.rotation, np.concatenate(seen).astype(np.float64))


def intrinsics(camera: Camera, name: str) -> dict:
    """Return the intrinsics of a camera in the form of the YAML file that the ROS package camera_info_manager reads.

    Args:
        camera: The camera.
        name: Its name in the file.
    """

    def matrix(values: Array) -> dict:
        return {"rows": values.shape[0], "cols": values.shape[1], "data": values.ravel().tolist()}

    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "camera_matrix": matrix(camera.matrix),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": matrix(np.array([camera.distortion])),
        "rectification_matrix": matrix(np.eye(3)),
        "projection_matrix": matrix(np.column_stack([camera.matrix, np.zeros(3)])),
    }


def pose(camera: Camera, name: str) -> dict:
    """Return the parameters that hold the pose of a camera of that name, for the nodes that use this camera."""
    values = {f"{name}.rotation": camera.rotation.ravel().tolist(), f"{name}.translation": camera.translation.tolist()}
    nodes = ("track", "learn") if name in WIDE_SIDES else ("estimate",)
    return {f"/**/{node}": {"ros__parameters": dict(values)} for node in nodes}


def with_camera(content: dict, camera: Camera, name: str) -> dict:
    """Return the content of a parameter file with the pose of a camera of that name set, and the intrinsics that camera_node publishes.

    The node that drives a wide camera publishes its intrinsics.

    Raises:
        TtError: `content` is that of no parameter file.
    """
    inner = {f"{name}.matrix": camera.matrix.ravel().tolist(), f"{name}.distortion": np.asarray(camera.distortion).tolist()}
    published = {} if name in WIDE_SIDES else {"/**/camera": {"ros__parameters": inner}}
    try:
        for node, entry in {**published, **pose(camera, name)}.items():
            content.setdefault(node, {}).setdefault("ros__parameters", {}).update(entry["ros__parameters"])
    except (AttributeError, TypeError) as error:
        raise TtError(f"no parameter file: {error}") from error
    return content


def picture(camera: Camera, pixels: Array, misses: Array) -> np.ndarray:
    """Draw the residuals of a calibration as arrows, enlarged by the factor ENLARGED.

    Args:
        camera: The calibrated camera.
        pixels: (n, 2) pixels, where the points were seen.
        misses: (n, 2) pixels, residuals: from there to where the calibrated camera projects the points.

    Returns:
        (h, w, 3) uint8, the picture in OpenCV's order of colours.
    """
    zoom = max(1.0, 900.0 / camera.width)
    image = np.full((round(camera.height * zoom), round(camera.width * zoom), 3), 255, dtype=np.uint8)
    for at, miss in zip(pixels, misses, strict=True):
        ends = [tuple(int(x) for x in np.round(zoom * end)) for end in (at, at + ENLARGED * miss)]
        cv2.arrowedLine(image, ends[0], ends[1], (60, 60, 200), 1, cv2.LINE_AA, tipLength=0.2)
        cv2.circle(image, ends[0], 2, (0, 0, 0), -1, cv2.LINE_AA)
    text = f"residuals x {ENLARGED:.0f}, rms {np.sqrt((misses**2).sum(axis=1).mean()):.3f} pixels"
    cv2.putText(image, text, (10, 25), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 1, cv2.LINE_AA)
    return image


def main() -> None:
    """Run the command: calibrate a camera, write the files, and print the result."""
    parser = argparse.ArgumentParser(prog="calibrate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--name", default="left", help="name of the camera and of the files: left, right, wide_left or wide_right (default left)"
    )
    parser.add_argument("--out", type=Path, default=Path(), help="directory of the files (default here)")
    parser.add_argument("--pixel-size", type=float, default=PIXEL_SIZE, help="size of a pixel, m (default 20e-6)")
    parser.add_argument("--distortion", action="store_true", help="estimate k1 and k2")
    kinds = parser.add_subparsers(dest="kind", required=True)
    known = kinds.add_parser("points", help="rows of x, y, z in m and u, v in pixels, separated by commas")
    known.add_argument("file", type=Path)
    known.add_argument("--width", type=int, default=232, help="of the image, pixels (default 232)")
    known.add_argument("--height", type=int, default=232, help="of the image, pixels (default 232)")
    known.add_argument("--focal-length", type=float, help="focal length, m; estimated without")
    known.add_argument(
        "--method",
        choices=("nonlinear", "linear"),
        default="nonlinear",
        help="least squares in the image, (B.66) to (B.71), or the linear solution, (B.77) to (B.87)",
    )
    board = kinds.add_parser("board", help="images of a chess board; the first one with the board flat on the table")
    board.add_argument("images", type=Path, nargs="+")
    board.add_argument("--columns", type=int, default=9, help="inner corners in a row")
    board.add_argument("--rows", type=int, default=6, help="inner corners in a column")
    board.add_argument("--square", type=float, required=True, help="side of a square, m")
    board.add_argument("--origin", type=float, nargs=3, default=(0.0, 0.0, 0.0), help="first inner corner of the first image in `table`, m")
    args = parser.parse_args()
    try:
        camera, points, pixels = from_points(args.file, args) if args.kind == "points" else from_board(args.images, args)
    except TtError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from error
    misses = camera.project(points) - pixels
    args.out.mkdir(parents=True, exist_ok=True)
    for suffix, content in (("", intrinsics(camera, args.name)), ("_pose", pose(camera, args.name))):
        (args.out / f"{args.name}{suffix}.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    both = args.out / CAMERAS
    try:
        content = with_camera(yaml.safe_load(both.read_text()) or {} if both.exists() else {}, camera, args.name)
    except (TtError, yaml.YAMLError, UnicodeDecodeError) as error:
        print(f"{both}: {error}", file=sys.stderr)
        raise SystemExit(2) from error
    both.write_text(yaml.safe_dump(content, sort_keys=False))
    cv2.imwrite(str(args.out / f"{args.name}_residuals.png"), picture(camera, pixels, misses))
    length = np.linalg.norm(misses, axis=1)
    table = Table("points", "rms pixels", "worst pixels", "focal length mm", "principal point", "k1, k2", "position m")
    u, v = camera.matrix[:2, 2]
    k1, k2 = camera.distortion[:2]  # type: ignore[index]
    position = ", ".join(f"{x:.4f}" for x in camera.position)
    rms, worst = f"{np.sqrt((length**2).mean()):.4f}", f"{length.max():.4f}"
    table.add_row(str(len(points)), rms, worst, f"{1e3 * camera.focal_length:.3f}", f"{u:.1f}, {v:.1f}", f"{k1:.3f}, {k2:.3f}", position)
    Console(width=120).print(table)
    print(f"written: {args.out / args.name}.yaml, {args.name}_pose.yaml, {args.name}_residuals.png, {CAMERAS}")


if __name__ == "__main__":
    main()
