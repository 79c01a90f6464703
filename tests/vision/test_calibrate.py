"""The calibration command, from points and from images of a board, gives back the camera that saw them."""

import sys

import cv2
import numpy as np
import pytest
import yaml
from refusals import check_named
from tt_core.params import params_from_values
from tt_vision import calibrate
from tt_vision.camera import Camera
from tt_vision.camera_node import Intrinsics
from tt_vision.estimate_node import read_poses
from tt_vision.rig import high_speed_pair

SQUARE, COLUMNS, ROWS = 0.025, 9, 6  # m, inner corners
ORIGIN = (1.0, 0.5, 0.0)


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["calibrate", *map(str, words)])
    calibrate.main()


def read(folder, name="left"):
    """The camera that the files describe."""
    inner = yaml.safe_load((folder / f"{name}.yaml").read_text())
    outer = yaml.safe_load((folder / f"{name}_pose.yaml").read_text())["/**/estimate"]["ros__parameters"]
    matrix = np.reshape(inner["camera_matrix"]["data"], (3, 3))
    rotation, translation = np.reshape(outer[f"{name}.rotation"], (3, 3)), outer[f"{name}.translation"]
    lens = inner["distortion_coefficients"]["data"]
    return Camera.from_matrix(rotation, translation, matrix, inner["image_width"], inner["image_height"], lens, 20e-6)


@pytest.mark.parametrize("method", ["nonlinear", "linear"])
def test_points_give_the_camera(method, tmp_path, monkeypatch, capsys):
    camera, rng = high_speed_pair()[0], np.random.default_rng(0)
    points = np.array([2.52, 0.7625, 0.365]) + rng.uniform(-0.05, 0.05, (30, 3))
    rows = np.column_stack([points, camera.project(points) + rng.normal(0.0, 0.02, (30, 2))])
    np.savetxt(tmp_path / "points.csv", rows, delimiter=",", header="x, y, z, u, v")
    run(monkeypatch, "--out", tmp_path, "points", tmp_path / "points.csv", "--focal-length", 0.035, "--method", method)
    found = read(tmp_path)
    assert np.abs(found.project(points) - camera.project(points)).max() < (0.05 if method == "nonlinear" else 0.5)  # pixels
    check_named(capsys.readouterr().out, len(points))
    assert cv2.imread(str(tmp_path / "left_residuals.png")).std() > 1.0


def board_seen_by(camera, corner, across, down):
    """(h, w) uint8 of a board whose first inner corner is at `corner` (3,) m and whose rows and columns run along `across`, `down` (3,)."""
    cell, margin = 40, 60
    squares = np.kron(np.indices((ROWS + 1, COLUMNS + 1)).sum(axis=0) % 2, np.ones((cell, cell)))
    sheet = np.pad(np.where(squares > 0, 30, 220).astype(np.uint8), margin, constant_values=220)
    offset = margin + cell - 0.5  # of the first inner corner in the sheet
    at = np.array([[0, 0], [COLUMNS - 1, 0], [COLUMNS - 1, ROWS - 1], [0, ROWS - 1]], dtype=np.float64)
    seen = camera.project(corner + SQUARE * (at[:, :1] * across + at[:, 1:] * down))
    warp = cv2.getPerspectiveTransform((offset + cell * at).astype(np.float32), seen.astype(np.float32))
    return cv2.warpPerspective(sheet, warp, (camera.width, camera.height), flags=cv2.INTER_AREA, borderValue=220)


def test_images_of_a_board_give_the_camera(tmp_path, monkeypatch, capsys):
    middle = np.array(ORIGIN) + SQUARE * np.array([4.0, -2.5, 0.0])
    camera = Camera.looking_at(middle + [0.15, -0.5, 0.6], middle, focal_length=18e-3, pixel_size=20e-6, width=640, height=480)
    rng, paths = np.random.default_rng(0), []
    for k in range(8):
        turn = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3) * (k > 0))[0]
        image = board_seen_by(camera, middle + turn @ (ORIGIN - middle), turn[:, 0], -turn[:, 1])
        paths.append(tmp_path / f"board_{k}.png")
        cv2.imwrite(str(paths[-1]), image)
    cv2.imwrite(str(tmp_path / "none.png"), np.full((480, 640), 128, np.uint8))
    words = ["--out", tmp_path, "--name", "right", "board", *paths, tmp_path / "none.png", "--square", SQUARE, "--origin", *ORIGIN]
    run(monkeypatch, *words)
    assert "432" in capsys.readouterr().out  # corners of eight boards, one image without
    found = read(tmp_path, "right")
    assert found.focal_length == pytest.approx(camera.focal_length, rel=0.01)
    assert np.linalg.norm(found.position - camera.position) < 0.01  # m; resampled squares are found to 0.05 pixels
    with pytest.raises(SystemExit):
        run(monkeypatch, "board", tmp_path / "none.png", "--square", SQUARE)
    check_named(capsys.readouterr().err, tmp_path / "none.png")


def test_one_file_holds_what_the_nodes_need_of_both_cameras(tmp_path, monkeypatch):
    rig = high_speed_pair()
    for name, camera in zip(("left", "right"), rig, strict=True):
        points = np.array([2.52, 0.7625, 0.365]) + np.random.default_rng(0).uniform(-0.05, 0.05, (30, 3))
        np.savetxt(tmp_path / "points.csv", np.column_stack([points, camera.project(points)]), delimiter=",")
        run(monkeypatch, "--out", tmp_path, "--name", name, "points", tmp_path / "points.csv", "--focal-length", 0.035)
    content = yaml.safe_load((tmp_path / "cameras.yaml").read_text())
    values = {node: entry["ros__parameters"] for node, entry in content.items()}
    poses = read_poses(lambda kind, prefix="": params_from_values(kind, values["/**/estimate"], prefix))
    for name, found, true in zip(("left", "right"), poses, rig, strict=True):
        assert found.position == pytest.approx(true.position, abs=0.01)  # m
        intrinsics = params_from_values(Intrinsics(), values["/**/camera"], f"{name}.")
        assert np.reshape(intrinsics.matrix, (3, 3)) == pytest.approx(true.matrix, rel=0.01, abs=1.0)
    (tmp_path / "cameras.yaml").write_text("[1]")
    with pytest.raises(SystemExit):
        run(monkeypatch, "--out", tmp_path, "points", tmp_path / "points.csv")


def test_what_cannot_be_read_says_so(tmp_path, monkeypatch, capsys):
    (tmp_path / "few.csv").write_text("1,2,3,4\n")
    for words, named in (
        (("points", tmp_path / "few.csv"), ("few.csv", 4)),
        (("points", tmp_path / "none.csv"), ("none.csv",)),
        (("board", tmp_path / "none.png", "--square", 0.02), ("none.png",)),
    ):
        with pytest.raises(SystemExit) as error:
            run(monkeypatch, *words)
        assert error.value.code == 2
        check_named(capsys.readouterr().err, *named)
