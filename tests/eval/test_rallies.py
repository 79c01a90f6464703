"""Shots of real play: mapped into `table`, those within reach, and played."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_eval import rallies
from tt_eval.episode import Trial
from tt_eval.scenario import load
from tt_eval.sensor_error_model import last_frame
from tt_racket.intercept import InterceptParams
from tt_sim.render import Lamps

ROW = dict.fromkeys([f"{what}_{axis}" for what in ("pos", "vel", "w_vel") for axis in "xyz"], 0.0)


def test_both_ways_are_turned_to_fly_to_the_robot(tmp_path):
    """Top spin in the file is w_x > 0 for a ball to -y; in `table` it is w_y < 0 for a ball to -x."""
    file = tmp_path / "rallies.json"
    there = ROW | {"pos_x": 0.1, "pos_y": 1.0, "pos_z": 0.3, "vel_x": 0.5, "vel_y": -5.0, "w_vel_x": 60.0}
    back = ROW | {"pos_x": -0.1, "pos_y": -1.0, "pos_z": 0.3, "vel_x": -0.5, "vel_y": 5.0, "w_vel_x": -60.0}
    file.write_text(json.dumps([there, back]))
    one, other = rallies.load_rallies(file)
    assert one.vector == pytest.approx([2.37, 0.6625, 0.3, -5.0, -0.5, 0.0, 0.0, -60.0, 0.0])
    assert other.vector == pytest.approx(one.vector)
    with pytest.raises(rallies.NoShots) as error:
        rallies.load_rallies(tmp_path / "none.json")
    assert error.value.file == tmp_path / "none.json"


@pytest.mark.parametrize(
    ("velocity", "reached"),
    [([-5.5, 0, 1.8], True), ([-5.0, 3.0, 1.0], False), ([-9.0, 0, 0.6], True), ([-2.0, 0, 1.0], False)],
    ids=["a usual one", "too wide", "a fast one", "into the net"],
)
def test_only_what_an_arm_could_be_asked_for(velocity, reached):
    ball = BallState(0.0, [2.6, 0.76, 0.3], velocity, [0, -200, 0])
    assert rallies.within_reach(ball, Physics.measured(), InterceptParams()) == reached


@pytest.mark.skipif(not os.environ.get("TT_DATA_DIR"), reason="TT_DATA_DIR names no folder of real data")
def test_real_play_is_seen_by_cameras_that_follow_it():
    shots = rallies.load_rallies(Path(os.environ["TT_DATA_DIR"]) / "deepmind" / "rallies.json")
    assert len(shots) == 13088  # data/README
    scenario = load("rallies", images=False)
    seen = [Trial.drawn(scenario, seed).guessed() for seed in range(40)]
    assert sum(ball is not None for ball in seen) >= 39  # lamps and cameras are where the ball is; all of 300 were seen on the day
    assert np.median([np.linalg.norm(ball.spin) for ball in seen if ball is not None]) > 50.0


@pytest.mark.skipif(not os.environ.get("TT_DATA_DIR"), reason="TT_DATA_DIR names no folder of real data")
def test_the_error_model_loses_the_balls_that_images_lose():
    """Whether a ball is seen, ball by ball, with the lamps as they stand for the launcher: a quarter is lost near them."""
    trials = [replace(Trial.drawn(load("rallies"), seed), lamps=Lamps()) for seed in range(200, 240)]
    expected = [last_frame(t.ball, t.cameras, t.physics) is None for t in trials]
    differ = [lost != (t.seen()[1] is None) for lost, t in zip(expected, trials, strict=True)]
    assert 4 <= sum(expected) <= 16  # 55 of 200 on the day
    assert sum(differ) <= 4  # 3 of 200 on the day, all of them near the limit of saturation
