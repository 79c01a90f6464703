"""Base and racket are found where they are, from touches, seen points and images of a board; what leaves something open is refused."""

import cv2
import numpy as np
import pinocchio as pin
import pytest
import yaml
from tt_arm.arm_file import load_arm
from tt_bringup.locate.fit import NotDetermined, UnknownCamera, fit_placement
from tt_bringup.locate.main import main
from tt_bringup.locate.observations import BadRows, PinholeCamera, Sighting, Touch, read_touches

PARTS = np.array([[0.0, 0.0, 0.0], [0.075, 0.0, 0.0], [0.0, 0.075, 0.0], [-0.05, 0.05, 0.0]])  # m, of the racket
MATRIX = np.array([[1500.0, 0.0, 320.0], [0.0, 1500.0, 240.0], [0.0, 0.0, 1.0]])  # pixels


def looking():
    """A camera 2.5 m in front of the robot that looks at its racket."""
    eye, target = np.array([1.9, 0.76, 0.9]), np.array([-0.3, 0.76, 0.3])
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(z, [0.0, 0.0, 1.0]))
    rotation = np.array([x, np.cross(z, x), z])
    return PinholeCamera(rotation, -rotation @ eye, MATRIX, np.array([0.05, -0.02, 0.0, 0.0, 0.0]))


def believed_and_true(name):
    """The arm as its file has it, and as it stands: 3 cm and 2 degrees away, the racket held 1 cm and 3 degrees off."""
    arm = load_arm(name)
    base = pin.SE3(pin.rpy.rpyToMatrix(0.01, -0.02, 0.035), np.array([0.02, -0.015, 0.01]))
    mount = pin.SE3(pin.rpy.rpyToMatrix(0.02, 0.03, -0.04), np.array([0.005, -0.006, 0.004]))
    return arm, base, mount


def true_pose(arm, base, mount, q):
    position, rotation = arm.racket(q)
    return base * pin.SE3(rotation, position) * mount


def postures(arm, count, seed=0):
    rng, (low, high) = np.random.default_rng(seed), arm.position_limits.T
    return np.clip(arm.waiting + 0.25 * (high - low) * rng.uniform(-1.0, 1.0, (count, len(low))), low, high)


@pytest.mark.parametrize("name", ["pa10", "frame5"])
@pytest.mark.parametrize("kind", ["touches", "pixels"])
def test_base_and_racket_are_found(name, kind):
    arm, base, mount = believed_and_true(name)
    rng, touches, sightings, camera = np.random.default_rng(1), [], [], looking()
    for k, q in enumerate(postures(arm, 24)):
        for part in PARTS if kind == "pixels" else PARTS[[k % 4]]:
            place = true_pose(arm, base, mount, q).act(part)
            if kind == "touches":
                touches.append(Touch(q, place + rng.normal(0.0, 2e-4, 3), part))
            else:
                sightings.append(Sighting(q, "left", camera.pixels(place[None])[0] + rng.normal(0.0, 0.1, 2), part))
    located = fit_placement(arm, touches, sightings, {"left": camera})
    for q in postures(arm, 20, seed=2):
        position, rotation = arm.racket(q)
        found = located.base * pin.SE3(rotation, position) * located.mount
        true = true_pose(arm, base, mount, q)
        assert found.translation == pytest.approx(true.translation, abs=1.5e-3)  # 0.5 mm in the median on the day
        assert np.linalg.norm(pin.log3(found.rotation.T @ true.rotation)) < np.radians(0.4)
    assert located.touched.size == len(touches) and located.seen.size == len(sightings)
    assert np.all(located.touched < 1e-3) and np.all(located.seen < 0.6)  # m, pixels
    assert all(np.all(sigma > 0.0) for sigma in located.sigma.values())


def test_what_is_known_is_kept():
    arm, base, _ = believed_and_true("pa10")
    touches = [Touch(q, true_pose(arm, base, pin.SE3.Identity(), q).act(np.zeros(3)), np.zeros(3)) for q in postures(arm, 6)]
    located = fit_placement(arm, touches, [], {}, ["mount"])
    assert located.base.homogeneous == pytest.approx(base.homogeneous, abs=1e-6)
    assert set(located.sigma) == {"base"} and np.allclose(located.mount.homogeneous, np.eye(4))


def test_what_is_left_open_is_refused():
    """One point of the racket tells nothing of how it is turned about it, and few touches tell little of anything."""
    arm, base, mount = believed_and_true("pa10")
    touches = [Touch(q, true_pose(arm, base, mount, q).act(np.zeros(3)), np.zeros(3)) for q in postures(arm, 20)]
    with pytest.raises(NotDetermined) as error:
        fit_placement(arm, touches, [], {})
    assert error.value.open == 3
    with pytest.raises(NotDetermined):
        fit_placement(arm, touches[:2], [], {})
    with pytest.raises(UnknownCamera):
        fit_placement(arm, [], [Sighting(arm.waiting, "middle", np.zeros(2), np.zeros(3))], {})


def test_the_command_writes_parameters_that_the_arm_node_takes(tmp_path):
    arm, base, mount = believed_and_true("pa10")
    lines = []
    for k, q in enumerate(postures(arm, 24)):
        place = true_pose(arm, base, mount, q).act(PARTS[k % 4])
        lines.append(",".join(f"{value:.9f}" for value in (*q, *place, *PARTS[k % 4])))
    (tmp_path / "touches.csv").write_text("# joints, place, point\n" + "\n".join(lines))
    main(["--robot", "pa10", "--touches", str(tmp_path / "touches.csv"), "--out", str(tmp_path / "place.yaml")])
    values = yaml.safe_load((tmp_path / "place.yaml").read_text())["/**/arm"]["ros__parameters"]
    placed = load_arm("pa10", values["base"], values["mount"])
    for q in postures(arm, 5, seed=3):
        true = true_pose(arm, base, mount, q)
        assert placed.racket(q)[0] == pytest.approx(true.translation, abs=1e-6)
        assert placed.racket(q)[1] == pytest.approx(true.rotation, abs=1e-6)


def board_image(camera, pose, corners, square):
    """A chess board on the racket's face, on a grey ground, as the camera sees it."""
    across, down = corners
    image, scale = np.full((480 * 2, 640 * 2), 128, np.uint8), 2.0
    middle = 0.5 * (np.array([across, down]) - 1.0)
    for y in range(-2, down + 1):
        for x in range(-2, across + 1):
            is_white = not (-1 <= x < across and -1 <= y < down) or (x + y) % 2
            square_corners = (np.array([[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]]) - middle) * square
            points = np.array([pose.act(np.array([*corner, 0.0])) for corner in square_corners])
            pixels = scale * (camera.pixels(points) + 0.5) - 0.5
            cv2.fillPoly(image, [np.round(pixels * 16).astype(np.int32)], 255 if is_white else 0, lineType=cv2.LINE_AA, shift=4)
    return cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)


def test_a_board_on_the_face_is_enough(tmp_path):
    """The images are drawn: a board of 20 mm squares, 2.5 m away, with 1,500 pixels of focal length."""
    arm, base, mount = believed_and_true("pa10")
    camera, rows, k = looking(), [], 0
    rng = np.random.default_rng(4)
    while len(rows) < 12 and k < 4000:
        k += 1
        q = np.clip(arm.waiting + rng.uniform(-0.5, 0.5, 7), *arm.position_limits.T)
        pose = true_pose(arm, base, mount, q)
        towards = camera.rotation[2] @ pose.rotation[:, 2]
        pixels = camera.pixels(pose.translation[None])[0]
        if towards > -0.8 or not (100 < pixels[0] < 540 and 100 < pixels[1] < 380):  # the face looks elsewhere, or is out of the image
            continue
        image = board_image(camera, pose, (4, 3), 0.02)
        cv2.imwrite(str(tmp_path / f"{len(rows)}.png"), image)
        rows.append(",".join([*(f"{value:.9f}" for value in q), "left", f"{len(rows)}.png"]))
    assert len(rows) == 12
    (tmp_path / "images.csv").write_text("\n".join(rows))
    camera_file = {
        "/**/camera": {"ros__parameters": {"left.matrix": camera.matrix.ravel().tolist(), "left.distortion": camera.distortion.tolist()}},
        "/**/estimate": {
            "ros__parameters": {"left.rotation": camera.rotation.ravel().tolist(), "left.translation": camera.translation.tolist()}
        },
    }
    (tmp_path / "cameras.yaml").write_text(yaml.safe_dump(camera_file))
    words = ["--images", str(tmp_path / "images.csv"), "--cameras", str(tmp_path / "cameras.yaml"), "--out", str(tmp_path / "place.yaml")]
    main(words)
    values = yaml.safe_load((tmp_path / "place.yaml").read_text())["/**/arm"]["ros__parameters"]
    placed = load_arm("pa10", values["base"], values["mount"])
    off = [placed.racket(q)[0] - true_pose(arm, base, mount, q).translation for q in arm.waiting + rng.uniform(-0.3, 0.3, (10, 7))]
    assert np.median(np.linalg.norm(off, axis=1)) < 5e-3  # m


def test_wrong_files_are_refused(tmp_path, capsys):
    file = tmp_path / "rows.csv"
    for text in ("", "1, 2, 3\n", ",".join(["a"] * 13), ",".join(["nan"] * 13)):
        file.write_text(text)
        with pytest.raises(BadRows):
            read_touches(file, 7)
    with pytest.raises(SystemExit) as error:
        main(["--touches", str(file)])
    assert error.value.code == 2 and "rows.csv" in capsys.readouterr().err
