"""Frames of a launch: all while the ball is in view, at the frame rate, showing it where it is."""

import numpy as np
import pytest
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_sim.cameras.camera_sequence import camera_sequence, in_view, orientation_after
from tt_sim.render import Scene
from tt_sim.world.launcher import LauncherParams, launch
from tt_vision.rig import FRAME_RATE, high_speed_pair

CAMERAS, PHYSICS = high_speed_pair(), Physics.liu()


@pytest.mark.parametrize(("kind", "scale"), [("top", 5), ("back", 3)])
def test_frames_follow_each_other_while_the_ball_is_in_view(kind, scale):
    rng = np.random.default_rng(3)
    ball, orientation = launch(kind, scale, LauncherParams(), rng)
    frames = list(camera_sequence(ball, orientation, CAMERAS, Scene(), PHYSICS, rng))
    assert len(frames) >= 15  # 13 cm and a ball's width at 7.5 m/s and 900 Hz
    assert np.diff([f.time for f in frames]) == pytest.approx(1 / FRAME_RATE, rel=1e-9)
    for frame in frames:
        now = fly(ball.vector, frame.time, PHYSICS.air.coefficients)[:3]
        for camera, image in zip(CAMERAS, frame.images, strict=True):
            u, v = camera.project(now[None])[0]
            if 40 < u < camera.width - 40 and 40 < v < camera.height - 40:
                bright = np.argwhere(image > 60)
                # the marks and the shaded side pull the bright part's middle off the centre, by less than half a radius (18 pixels)
                assert bright.mean(axis=0) == pytest.approx([v, u], abs=18)


def test_the_ball_turns_as_it_spins():
    ball, orientation = launch("top", 3, LauncherParams(), np.random.default_rng(4))
    period = 2 * np.pi / np.linalg.norm(ball.spin)
    assert orientation_after(orientation, ball, period, PHYSICS) == pytest.approx(orientation, abs=1e-9)
    small = orientation_after(orientation, ball, 1e-6, PHYSICS) @ orientation.T
    assert np.array([small[2, 1], small[0, 2], small[1, 0]]) * 1e6 == pytest.approx(ball.spin, rel=1e-3)


def test_a_ball_elsewhere_is_not_in_view():
    ball, _ = launch("top", 3, LauncherParams(), np.random.default_rng(5))
    assert not any(in_view(camera, type(ball).from_vector(0.0, ball.vector - 1.0)) for camera in CAMERAS)
