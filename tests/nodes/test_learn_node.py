"""Pixels, a measured ball and joint states in, learnt coefficients out, which the other nodes take."""

import numpy as np
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.factors import scaled
from tt_core.flight import fly
from tt_core.hit_windows import PATH_END_X
from tt_core.learnt_physics import physics_from_text
from tt_core.physics import Physics
from tt_core.ros.convert import ball_to_message, camera_to_message, path_from_message, pixel_to_message
from tt_core.ros.qos import LATCHED, RELIABLE, SENSOR
from tt_core.states import BallState
from tt_eval.contact_watch import racket_of
from tt_predict.rollout import StopRule, rollout
from tt_vision.rig import WIDE_RATE, WIDE_SIDES, wide_pair

MODEL, PHYSICS = ArmModel.pa10(), Physics.measured()
TRUE = scaled(PHYSICS, [0.03, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0])  # more drag, and a livelier rubber
AIR = TRUE.air.coefficients


def rally(rng):
    """Return a ball that meets the racket at 0 s: its states (9,) just before and after the contact, and the joint speeds (7,), rad/s."""
    speeds = rng.uniform(-0.5, 0.5, 7)
    met = racket_of(MODEL, Joints(0.0, np.array(MODEL.waiting), speeds))
    normal = met.racket.normal if met.racket.normal[0] > 0.0 else -met.racket.normal
    place = met.racket.position + 0.02 * normal
    before = np.concatenate([place, met.racket.velocity - 5.0 * normal, rng.normal(0.0, 60.0, 3)])
    velocity, spin = TRUE.racket.after(before[3:6], before[6:], met.racket)
    return before, np.concatenate([place, velocity, spin]), speeds


def test_balls_in_are_coefficients_out(start, probe, until):
    start("tt_bringup.learn_node", "--ros-args", "-p", "physics:=measured")
    start("tt_predict.predict_node", "--ros-args", "-p", "physics:=measured")
    got, rng, sigmas = [], np.random.default_rng(0), np.repeat([5e-4, 0.02, 3.0], 3)
    probe.create_subscription(String, "/physics", got.append, LATCHED)
    infos = [probe.create_publisher(CameraInfo, f"/camera/{name}/camera_info", LATCHED) for name in WIDE_SIDES]
    pixels = [probe.create_publisher(PointStamped, f"/camera/{name}/ball", SENSOR) for name in WIDE_SIDES]
    measured = probe.create_publisher(Odometry, "/ball/measured", RELIABLE)
    joints = probe.create_publisher(JointState, "/joint_states", 10)
    until(lambda: all(p.get_subscription_count() == 1 for p in [*infos, *pixels, measured, joints]), probe)
    until(lambda: probe.count_subscribers("/physics") == 2, probe)
    for camera, publisher, name in zip(wide_pair(), infos, WIDE_SIDES, strict=True):
        publisher.publish(camera_to_message(camera.width, camera.height, camera.matrix, camera.distortion, f"{name}_optical"))

    def play(first):
        """Publish one rally whose contact is at `first` (s), in order of time."""
        before, after, speeds = rally(rng)
        launched = fly(before, -0.35, AIR)
        ball = BallState.from_vector(first - 0.35, launched + sigmas * rng.normal(size=9), np.diag(sigmas**2))
        measured.publish(ball_to_message(ball))
        probe.executor.spin_once(timeout_sec=0.02)
        for since in np.arange(-0.34, 0.44, 1.0 / WIDE_RATE):
            place = fly(before if since < 0.0 else after, since, AIR)[:3]
            for camera, publisher, name in zip(wide_pair(), pixels, WIDE_SIDES, strict=True):
                pixel = camera.project(place[None])[0] + rng.normal(0.0, 0.1, 2)
                publisher.publish(pixel_to_message(first + since, pixel, f"{name}_optical"))
            probe.executor.spin_once(timeout_sec=0.003)
            for tick in (0.0, 0.003) if abs(since) < 0.02 else (0.0,):
                tell(first + since + tick, np.array(MODEL.waiting) + (since + tick) * speeds, speeds)
        for since in (1.5, 2.0):
            tell(first + since, np.array(MODEL.waiting), np.zeros(7))

    def tell(time, q, qdot):
        message = JointState(name=list(MODEL.names), position=q.tolist(), velocity=qdot.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = int(time), int(1e9 * (time % 1.0))
        joints.publish(message)
        probe.executor.spin_once(timeout_sec=0.003)

    times = iter(np.arange(100.0, 300.0, 10.0))  # more, should messages be lost on a busy machine
    until(lambda: play(next(times)) or len(got) >= 3, probe)
    learnt = physics_from_text(got[-1].data, "predict", PHYSICS)
    assert PHYSICS.racket.restitution < learnt.racket.restitution < 1.03 * TRUE.racket.restitution
    assert abs(learnt.racket.restitution / TRUE.racket.restitution - 1.0) < 0.025  # half of the way from where it was, at least

    paths, states = [], probe.create_publisher(Odometry, "/ball/state", RELIABLE)
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", paths.append, RELIABLE)
    until(lambda: states.get_subscription_count() == 1 and probe.count_publishers("/ball/path") == 1, probe)
    ball = BallState(500.0, [2.6, 0.76, 0.3], [-6.2, 0.1, 1.0], [20, -360, 30])
    until(lambda: paths or states.publish(ball_to_message(ball)), probe)
    ends = [rollout(ball, physics_from_text(one.data, "predict", PHYSICS), StopRule.at_x(PATH_END_X)).end.vector for one in got]
    off = [np.abs(path_from_message(paths[0]).end.vector - end).max() for end in ends]  # one of the last may have come after the state
    assert min(off) < 1e-6  # a stamp holds whole nanoseconds
