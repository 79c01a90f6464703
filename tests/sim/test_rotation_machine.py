"""The rotation machine: held in view, turning about the printed axes, measured like any other ball."""

import numpy as np
import pytest
from tt_core.constants import RPM
from tt_eval.episode import Trial, play
from tt_eval.scenario import load
from tt_eval.sweep import simulate_balls
from tt_sim.cameras.camera_sequence import camera_sequence
from tt_sim.render import Scene
from tt_sim.world import rotation_machine
from tt_sim.world.outcome import Result
from tt_vision.rig import VIEW_CENTRE


def test_all_axes_and_speeds_come_by_turns():
    balls = [rotation_machine.rotating_ball(i) for i in range(16)]
    spins = {tuple(np.round(ball.spin, 6)) for ball in balls}
    assert len(spins) == 8
    assert {round(float(np.linalg.norm(ball.spin)) / RPM) for ball in balls} == {1500, 2000, 2500, 3000}
    axis = balls[1].spin / np.linalg.norm(balls[1].spin)
    assert axis == pytest.approx(np.array(rotation_machine.AXES[1]) / np.linalg.norm(rotation_machine.AXES[1]), abs=1e-12)


@pytest.mark.parametrize("world", ["liu", "harsh"])
def test_the_ball_stays_where_it_is_held(world):
    trial = Trial.drawn(load("rotation", world=world), 3)
    frames = list(camera_sequence(trial.ball, trial.orientation, trial.cameras, Scene(), trial.physics, trial.rng, frame_rate=100.0))
    assert len(frames) > 10
    for frame in frames:
        for camera, image in zip(trial.cameras, frame.images, strict=True):
            rows, columns = np.nonzero(image > 3 * np.median(image))
            # pixels; lit from one side, the bright part leans: 4 at most on the day, of a ball 70 wide
            assert [columns.mean(), rows.mean()] == pytest.approx(camera.project(np.array([VIEW_CENTRE]))[0], abs=8.0)


def test_a_sweep_tells_the_errors_of_the_measurement():
    rows = simulate_balls(load("rotation"), 0, 8).to_pylist()
    assert [row["kind"] for row in rows] == ["rotation"] * 8 and all(row["seen"] for row in rows)
    assert sorted(round(row["spin_rpm"]) for row in rows) == [1500, 1500, 2000, 2000, 2500, 2500, 3000, 3000]
    for row in rows:
        assert row["measured_spin_error_rpm"] < 30.0  # 17 at most on the day; the dissertation: within 200 in 89 %
        assert row["measured_axis_error_deg"] < 1.0
        assert abs(row["measured_speed_error_rpm"]) <= row["measured_spin_error_rpm"] + 1e-9
        assert not row["hit"] and row["miss"] == "out of reach"  # it does not come to the robot


def test_the_error_model_plays_it_too():
    episode = play(load("rotation", images=False), 2)
    assert episode.measured is not None and episode.outcome.result is episode.judged.result is Result.MISSED
    assert episode.measured.position == pytest.approx(VIEW_CENTRE, abs=2e-3)  # m
