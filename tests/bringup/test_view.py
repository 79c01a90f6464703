"""What the view shows: the scene's items and how long they stay, the arm of any URDF, clicks, and who may open the page."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tt_arm.arm_file import load_arm
from tt_arm.description import placed_description
from tt_arm.model import ArmModel
from tt_bringup.view.gate import Decision, Request, decide
from tt_bringup.view.items import Shape, ellipsoid
from tt_bringup.view.page import clicked_place, side_by_side
from tt_bringup.view.readings import Health, Readings
from tt_bringup.view.robot_shapes import RobotShapes
from tt_bringup.view.scene import DrawnScene, ShownJoints
from tt_bringup.view.scene_inputs import landing_place
from tt_core.constants import BALL_RADIUS
from tt_core.errors import TtError
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState, ReturnGoal
from tt_predict.rollout import StopRule, rollout

PA10 = ArmModel.pa10().placed_description
BALL = BallState(100.0, [2.3, 0.76, 0.3], [-5.0, 0.0, 1.5], [0.0, -200.0, 0.0], np.diag([1e-6] * 3 + [1e-4] * 3 + [1.0] * 3))


@pytest.fixture
def scene():
    return DrawnScene(RobotShapes(PA10), Physics.liu())


def named(scene, now):
    return {item.name: item for item in scene.items(now)}


@pytest.mark.parametrize("arm", [("pa10",), ("pa10", (-0.5, 0.3, 0.1, 0.7), (0.2, 1.1)), ("frame5", (0.1, 0.7, 0.1, 0.1, 0.2, 0.3))])
def test_the_drawn_racket_is_where_the_model_has_it(arm):
    model = load_arm(*arm)
    shapes, rng = RobotShapes(model.placed_description), np.random.default_rng(0)
    for q in rng.uniform(*model.position_limits.T, (5, len(model.names))):
        racket = {item.name: item for item in shapes.items(dict(zip(model.names, q, strict=True)))}["arm/racket/0"]
        position, rotation = model.racket(q)
        assert racket.position == pytest.approx(position, abs=1e-12)
        assert racket.rotation == pytest.approx(rotation, abs=1e-12)
    assert shapes.speed_limits == pytest.approx(dict(zip(model.names, model.speed_limits, strict=True)))


def test_a_foreign_arm_is_drawn_with_its_own_shapes():
    """A linear joint, a joint without limits, a mesh, a box, a sphere, a named material, another root."""
    urdf = """<robot name="other"><material name="blue"><color rgba="0 0 1 0.5"/></material>
      <link name="rail"><visual><geometry><box size="2 0.1 0.2"/></geometry><material name="blue"/></visual></link>
      <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" velocity="3" effort="9"/></joint>
      <link name="cart"><visual><origin xyz="0 0 0.5"/><geometry><sphere radius="0.2"/></geometry></visual></link>
      <joint name="turn" type="continuous"><parent link="cart"/><child link="hand"/><axis xyz="0 0 1"/>
        <limit velocity="5" effort="9"/></joint>
      <link name="hand"><visual><origin xyz="1 0 0"/><geometry><mesh filename="package://other/hand.stl" scale="1 2 3"/></geometry></visual>
      </link></robot>"""
    items = {item.name: item for item in RobotShapes(urdf).items({"slide": 0.4, "turn": 0.5 * np.pi})}
    assert items["arm/rail/0"].shape is Shape.BOX and items["arm/rail/0"].colour == (0.0, 0.0, 1.0, 0.5)
    assert items["arm/cart/0"].position == pytest.approx([0.4, 0.0, 0.5])
    hand = items["arm/hand/0"]
    assert (hand.shape, hand.mesh, hand.size.tolist()) == (Shape.MESH, "package://other/hand.stl", [1.0, 2.0, 3.0])
    assert hand.position == pytest.approx([0.4, 1.0, 0.0])


@pytest.mark.parametrize(
    "urdf",
    [
        "",
        "<robot/>",
        "no XML",
        PA10.replace('radius="0.09"', 'radius="thick"'),
        PA10.replace('radius="0.09"', 'radius="nan"'),
        PA10.replace('xyz="0 0 0.148"', 'xyz="0 0"'),
    ],
)
def test_a_broken_description_is_refused(urdf):
    with pytest.raises(TtError):
        RobotShapes(urdf)


def test_a_description_without_one_root_is_refused():
    for urdf in ("<robot/>", "<robot><link name='a'/><link name='b'/></robot>", "no XML"):
        with pytest.raises(TtError):
            placed_description(urdf, pin.SE3.Identity())


def test_a_placed_description_is_placed_once():
    assert RobotShapes(placed_description(PA10, pin.SE3(np.eye(3), np.full(3, 9.0)))).items({})[0].position == pytest.approx(
        RobotShapes(PA10).items({})[0].position
    )


def test_table_arm_and_nothing_else_are_there_from_the_start(scene):
    assert {name.split("/")[0] for name in named(scene, 0.0)} == {"table", "arm"}


@pytest.mark.parametrize("lag", [0.05, 1e9])  # s from stamp to arrival: live, and a bag of years ago
def test_a_ball_flies_along_its_path_and_is_gone_afterwards(scene, lag):
    path = rollout(BALL, Physics.liu(), StopRule.at_x(-0.3))
    scene.take_joints(100.0, ShownJoints(), 100.0 + lag)
    scene.take_estimate(BALL, 100.06 + lag)
    scene.take_path(path, 100.07 + lag)
    for time in (100.1, 100.3):
        items = named(scene, time + lag)
        # m; arrivals of the bag are known to 1e-7 s at 5 m/s
        assert items["estimated_ball/ball"].position == pytest.approx(path.at(time).position, abs=1e-5)
        assert items["estimated_ball/trail"].points[0] == pytest.approx(BALL.position)
    assert "path/bounce0" in items and sum(name.startswith("path/uncertainty") for name in items) == 8
    end = path.times[-1] + lag
    assert "estimated_ball/ball" not in named(scene, end + 0.1) and "path/ahead" in named(scene, end + 0.1)
    assert {name.split("/")[0] for name in named(scene, end + 3.0)} == {"table", "arm"}


def test_uncertainty_grows_along_the_path(scene):
    scene.take_estimate(BALL, 100.0)
    scene.take_path(rollout(BALL, Physics.liu(), StopRule.at_x(-0.3)), 100.0)
    items = named(scene, 100.1)
    sizes = [items[f"path/uncertainty{i}"].size.max() for i in range(8)]
    assert sizes[-1] > 2.0 * sizes[0] > 0.0


def test_uncertainty_is_that_of_the_state_from_which_the_path_was_predicted(scene):
    for i in range(4):  # the tracker is ahead of the prediction
        scene.take_estimate(replace(BALL, time=BALL.time + 0.01 * i, covariance=1e-6 * (1.0 + i) * np.eye(9)), 100.0)
    sizes = []
    for i in (0, 2):
        scene.take_path(rollout(replace(BALL, time=BALL.time + 0.01 * i), Physics.liu(), StopRule.at_x(-0.3)), 100.1)
        sizes.append(named(scene, 100.11)["path/uncertainty0"].size)
    assert sizes[1] == pytest.approx(np.sqrt(3.0) * sizes[0], rel=1e-6)  # covariance three times as large


def test_an_ellipsoid_has_the_axes_of_its_covariance():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    item = ellipsoid("e", (0, 0, 0, 1), np.zeros(3), root @ root.T, 2.0)
    assert np.linalg.det(item.rotation) == pytest.approx(1.0)
    assert item.rotation @ np.diag((item.size / 4.0) ** 2) @ item.rotation.T == pytest.approx(root @ root.T)


def test_true_ball_strokes_goal_and_landing_come_and_go(scene):
    scene.take_true_ball(BALL, 100.0)
    scene.take_true_ball(BallState(100.01, BALL.position + 0.05, BALL.velocity, BALL.spin), 100.01)
    rackets = [RacketState(100.5, [-0.2, 0.7, 0.3], [2.0, 0.0, 0.5], 0.0, 1.5 + 0.01 * i) for i in range(20)]
    scene.take_strokes(rackets, 100.0, 100.1)
    scene.take_goal(ReturnGoal(np.array([2.0, 0.5]), 0.6, 0.0, 0.0))
    scene.take_landing(np.array([2.1, 0.6, BALL_RADIUS]), 100.2)
    items = named(scene, 100.25)
    spin = items["true_ball/spin"].points
    assert np.cross(spin[1] - spin[0], BALL.spin) == pytest.approx(np.zeros(3), abs=1e-9) and (spin[1] - spin[0]) @ BALL.spin > 0.0
    assert len(items["true_ball/trail"].points) == 2
    assert sum(name.startswith("strokes/") for name in items) == 7  # six candidates, and the velocity of the best
    assert items["strokes/0"].rotation[:, 2] == pytest.approx(rackets[0].normal)
    assert items["landing/asked"].position[:2] == pytest.approx([2.0, 0.5])
    assert items["landing/reached"].position == pytest.approx([2.1, 0.6, BALL_RADIUS])
    assert {name.split("/")[0] for name in named(scene, 110.0)} == {"table", "arm", "landing"}  # a goal holds until the next one
    assert "landing/reached" not in named(scene, 110.0)


def test_a_clock_that_is_set_back_begins_anew(scene):
    scene.take_true_ball(BALL, 100.0)
    assert "true_ball/ball" in named(scene, 100.1)
    assert "true_ball/ball" not in named(scene, 50.0)


def test_an_unchanged_item_is_the_same_object(scene):
    scene.take_joints(1.0, ShownJoints({"s1": 0.1}), 1.0)
    first = named(scene, 1.0)
    scene.take_joints(1.1, ShownJoints({"s1": 0.1}), 1.1)
    assert all(item is first[name] for name, item in named(scene, 1.1).items())


def test_a_click_is_where_its_ray_meets_the_far_half():
    eye, place = np.array([-1.9, -2.6, 1.9]), np.array([2.0, 0.5, 0.0])
    assert clicked_place(eye, place - eye) == pytest.approx(place[:2])
    for elsewhere in ([1.0, 0.5, 0.0], [2.0, 1.6, 0.0], [2.8, 0.5, 0.0], [2.0, 0.5, 3.0]):
        assert clicked_place(eye, np.array(elsewhere) - eye) is None
    assert clicked_place(np.array([2.0, 0.5, -1.0]), np.array([0.0, 0.0, 1.0])) is None  # from below


@pytest.mark.parametrize("shape, kind", [((232, 232), np.uint8), ((1080, 1920), np.uint16), ((1, 5), np.uint8)])
def test_images_are_shown_small_and_bright(shape, kind):
    image = np.zeros(shape, kind)
    image[: shape[0] // 2 + 1] = 100
    shown = side_by_side((image, image))
    assert shown.dtype == np.uint8 and shown.shape == (232, 464, 3)
    assert np.array_equal(shown[:, :232], shown[:, 232:]) and shown.max() == 255
    assert not side_by_side(()).any()


def test_readings_are_bounded_and_ordered():
    readings = Readings()
    for i in range(200):
        readings.take_latency("slow", 50.0 + i % 2)
        readings.take_latency("fast", 5.0)
        readings.take_health([Health(0.1 * i, f"node {i}", 0, "fine")])
    assert [stage for stage, _, _ in readings.median_latencies()] == ["fast", "slow"]
    assert len(readings.health) == 60 and "node 199" in readings.health
    readings.take_health([Health(19.9, "bad", 2, "broken")])
    shown = readings.health_at(20.0)
    assert [status.level for status in shown] == [3] * 10 + [2] + [0] * 49  # what is older than 5 s is stale


def test_of_a_burst_the_brightest_image_is_kept():
    readings, levels = Readings(), []
    for now, level in ((0.0, 1), (0.1, 3), (0.2, 2), (0.9, 2), (1.2, 2), (1.3, 2), (0.5, 1)):  # s; at the end the clock is set back
        readings.take_image("left", np.full((2, 2), level, np.uint8), now)
        levels.append(int(readings.images["left"].image[0, 0]))
    assert levels == [1, 3, 3, 3, 2, 2, 1]


@pytest.mark.parametrize("text", ["null", "", "[1]", "[1, 2, 3, null]", "[1, 2, 3, NaN]", "{}", '{"a": 1}', "7"])
def test_a_landing_that_is_none_is_not_shown(text):
    assert landing_place({"landing": text}) is None
    assert landing_place({}) is None


def test_a_landing_is_a_place():
    assert landing_place({"landing": "[5.0, 2.0, 0.7, 0.02, 3.0]"}) == pytest.approx([2.0, 0.7, 0.02])


def request(target="/", **headers):
    lines = [f"GET {target} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return Request.parse("\r\n".join([*lines, "", ""]).encode())


SOCKET = {"Upgrade": "websocket", "Connection": "Upgrade"}


@pytest.mark.parametrize(
    "asked, token, answer",
    [
        (request(Host="127.0.0.1:8080"), "", Decision.ADMIT),
        (request(Host="localhost:8080"), "", Decision.ADMIT),
        (request(Host="[::1]:8080"), "", Decision.ADMIT),
        (request(Host="evil.example:8080"), "", Decision.REFUSE),
        (request(), "", Decision.REFUSE),
        (request(Host="127.0.0.1:8080", Origin="http://127.0.0.1:8080", **SOCKET), "", Decision.ADMIT),
        (request(Host="127.0.0.1:8080", Origin="http://evil.example", **SOCKET), "", Decision.REFUSE),
        (request(Host="robot:8080"), "secret", Decision.REFUSE),
        (request("/?token=wrong", Host="robot:8080"), "secret", Decision.REFUSE),
        (request("/?token=secret", Host="robot:8080"), "secret", Decision.REMEMBER),
        (request(Host="robot:8080", Cookie="a=b; view_token=secret"), "secret", Decision.ADMIT),
        (request(Host="robot:8080", Cookie="view_token=secre"), "secret", Decision.REFUSE),
        (request(Host="robot:8080", Origin="http://robot:8080", Cookie="view_token=secret", **SOCKET), "secret", Decision.ADMIT),
        (request(Host="robot:8080", Origin="http://other:8080", Cookie="view_token=secret", **SOCKET), "secret", Decision.REFUSE),
        (request("/?token=secret", Host="robot:8080", **SOCKET), "secret", Decision.ADMIT),
        (request(Host="robot:8080", **SOCKET), "secret", Decision.REFUSE),
    ],
)
def test_who_may_open_the_page(asked, token, answer):
    assert decide(asked, token) is answer


def test_what_is_no_request_is_refused():
    for head in (b"\r\n\r\n", b"HELLO\r\n\r\n", b"GET / SPDY/3\r\n\r\n"):
        with pytest.raises(TtError):
            Request.parse(head)
