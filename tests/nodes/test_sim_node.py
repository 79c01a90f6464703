"""The node is wired: a launch becomes images at their stamps, the arm obeys, the truth is told."""

import json
from itertools import pairwise

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from refusals import check_named, is_told
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from tt_arm.arm_file import load_arm
from tt_core.errors import MessageFailure, ValueFailure
from tt_core.failures import Failure
from tt_core.ros.convert import ball_from_message, image_from_message, pixel_from_message, seconds
from tt_core.ros.diagnostics import Event, read_status
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE, SENSOR, TRUTH
from tt_sim.sim_node import SimFailure
from tt_vision.camera import triangulate
from tt_vision.rig import wide_pair


def until_subscriptions_are_known(probe, until):
    """Wait until the simulator answers: DDS tells of endpoints in their order, so it then knows the subscriptions that were made before."""
    step = probe.create_client(Trigger, "/sim/step")
    until(step.service_is_ready, probe)
    answer = step.call_async(Trigger.Request())
    until(answer.done, probe)


def test_a_launch_becomes_images_and_its_end_is_told(start, probe, until):
    start("tt_sim.sim_node", "--ros-args", "-p", "shots:=['back 4']")
    images, infos, truth, statuses = [], [], [], []
    for side in ("left", "right"):
        probe.create_subscription(Image, f"/camera/{side}/image_raw", images.append, SENSOR)
        probe.create_subscription(CameraInfo, f"/camera/{side}/camera_info", infos.append, LATCHED)
    probe.create_subscription(Odometry, "/sim/ball", truth.append, TRUTH)
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, RELIABLE)
    client = probe.create_client(Trigger, "/launcher/launch")
    until(client.service_is_ready, probe)
    until(lambda: len(infos) == 2 and probe.count_publishers("/sim/ball") == 1, probe)
    until_subscriptions_are_known(probe, until)

    first, second = client.call_async(Trigger.Request()), client.call_async(Trigger.Request())
    until(lambda: first.done() and second.done(), probe)
    assert (first.result().success, first.result().message) == (True, "back 4")
    assert not second.result().success

    until(lambda: any(t.event is Event.BALL_OVER for m in statuses for t in read_status(m)), probe)
    frames = sorted({seconds(m.header.stamp) for m in images})
    assert len(frames) > 15
    assert np.diff(frames) == pytest.approx(1 / 900, abs=1e-6)  # s; nothing was lost either
    assert image_from_message(images[len(images) // 2]).shape == (232, 232)
    until(lambda: any(a.header.stamp == b.header.stamp for a, b in pairwise(truth)), probe)  # a bounce
    balls = [ball_from_message(m) for m in truth]
    contacts = [a for a, b in pairwise(balls) if a.time == b.time]
    assert contacts[0].position[2] == pytest.approx(0.02, abs=1e-9)  # m, the bounce


def test_at_a_rate_it_launches_by_itself(start, probe, until):
    """94 a minute: the next ball is launched while the last one still bounces behind the table. At a third of real time, so that a busy
    machine, too, has rendered the next one in time."""
    start("tt_sim.sim_node", "--ros-args", "-p", "shots:=['top 3']", "-p", "launcher.rate:=94.0", "-p", "rtf:=0.33")
    statuses = []
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, RELIABLE)
    client = probe.create_client(Trigger, "/launcher/launch")
    until(client.service_is_ready, probe)
    asked = client.call_async(Trigger.Request())

    def over():
        return [t.values for m in statuses for t in read_status(m) if t.event is Event.BALL_OVER]

    until(lambda: asked.done() and len(over()) >= 4, probe)
    assert not asked.result().success
    launched = [json.loads(values["launched"])[0] for values in over()]
    # s; whole ticks of 2 ms
    assert np.min(np.diff(launched)) == pytest.approx(60 / 94, abs=0.004)
    assert [int(values["number"]) for values in over()] == list(range(int(over()[0]["number"]), int(over()[0]["number"]) + len(over())))


def test_a_ball_on_request_after_a_rate_is_the_one_that_is_asked_for(start, probe, until):
    """What was rendered ahead at the rate is dropped with it."""
    start("tt_sim.sim_node", "--ros-args", "-p", "shots:=['top 3']", "-p", "launcher.rate:=60.0")
    statuses = []
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, RELIABLE)
    launcher, setter = probe.create_client(Trigger, "/launcher/launch"), probe.create_client(SetParameters, "/sim/set_parameters")

    def shots():
        return [t.values["shot"] for m in statuses for t in read_status(m) if t.event is Event.BALL_OVER]

    until(lambda: launcher.service_is_ready() and setter.service_is_ready() and shots(), probe)
    values = (("shots", ["back 3"]), ("launcher.rate", 0.0))
    changed = setter.call_async(SetParameters.Request(parameters=[Parameter(n, value=v).to_parameter_msg() for n, v in values]))
    until(changed.done, probe)
    assert all(result.successful for result in changed.result().results)
    asked = launcher.call_async(Trigger.Request())
    until(lambda: asked.done() and "back 3" in shots(), probe)
    assert asked.result().success and shots().count("back 3") == 1
    assert shots()[-1] == "back 3" and len(shots()) <= 4  # those that flew when the rate was changed, MOST_FLYING at most, come first


def test_cameras_of_a_world_lose_and_stamp_frames_as_it_says(start, probe, until, tmp_path):
    world = tmp_path / "blind.yaml"
    world.write_text("cameras: {dropped: 0.4, clock_offset: 0.5}")
    start("tt_sim.sim_node", "--ros-args", "-p", "shots:=['back 3']", "-p", f"world:={world}")
    images, statuses = [], []
    for side in ("left", "right"):
        probe.create_subscription(Image, f"/camera/{side}/image_raw", images.append, SENSOR)
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, RELIABLE)
    client = probe.create_client(Trigger, "/launcher/launch")
    until(client.service_is_ready, probe)
    until_subscriptions_are_known(probe, until)
    client.call_async(Trigger.Request())
    until(lambda: any(t.event is Event.BALL_OVER for m in statuses for t in read_status(m)), probe)
    (values,) = [t.values for m in statuses for t in read_status(m) if t.event is Event.BALL_OVER]
    after = np.array([seconds(m.header.stamp) for m in images]) - json.loads(values["launched"])[0] - 0.5
    assert np.all((after > 0.0) & (after < 0.2))  # s, while the ball is in view, by a clock half a second ahead
    whole = 2 * (1 + round(900 * (after.max() - after.min())))
    assert 0.25 * whole < len(images) < 0.9 * whole  # 0.6 of them; 5 standard deviations of 50 images are 0.35


def test_the_wide_cameras_tell_where_they_see_the_ball(start, probe, until):
    """From behind the catapult to behind the robot's end, the places of the true ball, by 150 Hz."""
    start("tt_sim.sim_node", "--ros-args", "-p", "shots:=['top 4']")
    seen, truth, statuses = {"wide_left": {}, "wide_right": {}}, [], []
    for name, pixels in seen.items():

        def keep(message, name=name, pixels=pixels):
            assert message.header.frame_id == f"{name}_optical"
            time, pixel = pixel_from_message(message)
            pixels[round(time, 6)] = pixel

        probe.create_subscription(PointStamped, f"/camera/{name}/ball", keep, SENSOR)
    probe.create_subscription(Odometry, "/sim/ball", truth.append, TRUTH)
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, RELIABLE)
    client = probe.create_client(Trigger, "/launcher/launch")
    until(client.service_is_ready, probe)
    until(lambda: probe.count_publishers("/sim/ball") == 1 and probe.count_publishers("/camera/wide_right/ball") == 1, probe)
    until_subscriptions_are_known(probe, until)
    client.call_async(Trigger.Request())
    until(lambda: any(t.event is Event.BALL_OVER for m in statuses for t in read_status(m)), probe)
    until(lambda: truth[-1:] and truth[-1].pose.pose.position.x < 0.0, probe)
    left, right = seen.values()
    balls = [ball_from_message(m) for m in truth]
    behind = next(ball.time for ball in balls if ball.position[0] < 0.0)  # s, when the ball is behind the robot's end
    until(lambda: min(max(left, default=0.0), max(right, default=0.0)) > behind, probe)  # other topics may be behind the diagnostics
    both = sorted(t for t in left.keys() & right.keys() if balls[0].time < t < balls[-1].time)
    assert len(both) > 50  # of about 90 frames in 0.6 s, some of which a busy machine may lose
    steps = np.diff(both) * 150
    assert steps == pytest.approx(np.round(steps), abs=1e-3) and np.median(steps) == pytest.approx(1.0, abs=1e-3)
    places = triangulate(wide_pair(), np.array([[pixels[t] for t in both] for pixels in (left, right)]))
    path = np.array([[ball.time, *ball.position] for ball in balls])
    expected = np.column_stack([np.interp(both, path[:, 0], path[:, k]) for k in (1, 2, 3)])
    assert np.abs(places - expected).max() < 6e-3  # m: 0.1 pixels of 6 mm, a little more in depth, 5 times
    assert expected[0, 0] > 2.3 and expected[-1, 0] < 0.0


def test_always_on_publishes_frames_without_a_ball(start, probe, until):
    start("tt_sim.sim_node", "--ros-args", "-p", "always_on:=true")
    stamps = []
    probe.create_subscription(Image, "/camera/left/image_raw", lambda m: stamps.append(seconds(m.header.stamp)), SENSOR)
    until(lambda: len(stamps) > 300, probe)
    # the median: a busy machine may lose frames, and falls behind for a while
    assert np.median(np.diff(stamps)) == pytest.approx(1 / 900, abs=1e-5)


def commanded(probe, until, speed):
    """Publish commands of `speed` rad/s for the last joint until it moves so; return the publisher, and lists of states and of statuses."""
    states, statuses = [], []
    probe.create_subscription(JointState, "/joint_states", states.append, RELIABLE)
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda m: statuses.extend(read_status(m)), RELIABLE)
    out = probe.create_publisher(Float64MultiArray, "/arm_velocity_controller/commands", LATEST)
    until(lambda: out.get_subscription_count() == 1 and states, probe)
    keep_moving(probe, until, states, out, speed)
    return out, states, statuses


def keep_moving(probe, until, states, out, speed):
    until(lambda: abs(states[-1].velocity[6] - speed) < 1e-3 or out.publish(Float64MultiArray(data=[0.0] * 6 + [speed])), probe)


def brakes(states, first):
    """Whether the last joint, moving backwards, has come to rest since the state `first`, nowhere faster than at the braking limit."""
    speeds = np.array([[seconds(m.header.stamp), m.velocity[6]] for m in states[first - 1 :]])
    if abs(speeds[-1, 1]) > 1e-3:
        return False
    # rounding of stamps; a tick that this process lost makes the step longer in time, too
    assert np.all(np.diff(speeds[:, 1]) <= 20.0 * 1.001 * np.diff(speeds[:, 0]))
    return True


def test_the_arm_does_what_it_is_told(start, probe, until):
    start("tt_sim.sim_node")
    _, states, _ = commanded(probe, until, 0.5)
    assert states[-1].velocity[:6] == pytest.approx([0.0] * 6, abs=1e-6)


def test_without_good_commands_the_drives_brake(start, probe, until):
    """Until there are good ones again."""
    start("tt_sim.sim_node")
    out, states, statuses = commanded(probe, until, -1.0)

    def brake_and_go_on(last, failure):
        """Send `last` (None: nothing) while the joint moves backwards until it has braked and `failure` is told, then move it forwards."""
        keep_moving(probe, until, states, out, -1.0)
        statuses.clear()
        first = len(states)
        until(lambda: brakes(states, first) or (last and out.publish(Float64MultiArray(data=last))), probe)
        until(lambda: is_told(failure, statuses), probe)
        keep_moving(probe, until, states, out, 0.5)

    brake_and_go_on(None, Failure(SimFailure.NO_COMMAND))
    brake_and_go_on([1.0, 2.0], Failure(ValueFailure.BAD_SHAPE, shape=(2,)))
    brake_and_go_on([np.nan] * 7, Failure(ValueFailure.NOT_FINITE))
    brake_and_go_on([np.inf] * 7, Failure(ValueFailure.NOT_FINITE))
    brake_and_go_on([1e17] * 7, Failure(ValueFailure.OUT_OF_RANGE, value=1e17))
    brake_and_go_on([0.0] * 1000, Failure(MessageFailure.TOO_LARGE))


def test_two_who_command_are_both_refused_by_name(start, probe, until):
    """Until one is left; the other one is a node of its own name."""
    start("tt_sim.sim_node")
    out, states, statuses = commanded(probe, until, -1.0)
    import rclpy

    other = rclpy.create_node("intruder", context=probe.context)
    other.create_publisher(Float64MultiArray, "/arm_velocity_controller/commands", LATEST)
    first = len(states)

    failure = Failure(SimFailure.SECOND_PUBLISHER, count=2, names="/intruder, /probe")

    def refused():
        out.publish(Float64MultiArray(data=[0.0] * 6 + [-1.0]))
        return is_told(failure, statuses) and brakes(states, first)

    until(refused, probe)
    other.destroy_node()
    keep_moving(probe, until, states, out, -0.5)


def test_the_arm_s_own_record_is_told_and_at_once_when_a_bound_is_broken(start, probe, until):
    start("tt_sim.sim_node")
    out, _, statuses = commanded(probe, until, 5.0)

    def record():
        return [status.values for status in statuses if status.name == "sim: arm record"]

    until(lambda: len(record()) >= 2, probe)
    assert all(float(values["speed"]) <= 1.0 and int(values["end_stop_hits"]) == 0 for values in record()[:1])
    until(lambda: int(record()[-1]["end_stop_hits"]) > 0 or out.publish(Float64MultiArray(data=[0.0] * 6 + [5.0])), probe)
    broken = record()[-1]
    assert broken["code"] == SimFailure.BOUND_BROKEN.name and float(broken["limit_distance"]) == 0.0
    assert float(broken["acceleration"]) > 100.0  # rad/s^2: 5 rad/s in one tick of 2 ms is 2500


def test_killed_and_started_again_it_works_at_once(start, probe, until):
    for _ in range(3):
        node = start("tt_sim.sim_node")
        states = []
        listening = probe.create_subscription(JointState, "/joint_states", states.append, RELIABLE)
        out = probe.create_publisher(Float64MultiArray, "/arm_velocity_controller/commands", LATEST)
        until(lambda states=states: states, probe)
        assert states[0].position == pytest.approx(load_arm("pa10").waiting, abs=1e-9)
        keep_moving(probe, until, states, out, -0.5)
        node.kill()
        node.wait()
        probe.destroy_subscription(listening)
        probe.destroy_publisher(out)


def test_bad_parameters_end_it_with_the_reason(start):
    for parameter, named in (
        ("shots:=['smash 3']", ("kind", "smash")),
        ("rtf:=0.0", ("rtf", 0)),
        ("world:=mars", ("mars",)),
    ):
        node = start("tt_sim.sim_node", "--ros-args", "-p", parameter)
        assert node.wait(timeout=120) == 2
        check_named(node.stderr.read(), *named)
