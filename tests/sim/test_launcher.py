"""The catapult shoots what its tables say, and nothing else."""

import numpy as np
import pytest
from tt_core.errors import OutOfRange, TtError
from tt_core.physics import Physics
from tt_predict.rollout import StopRule, rollout
from tt_sim.launcher import KINDS, LauncherParams, launch


@pytest.mark.parametrize(
    ("kind", "scale", "v_x", "v_z", "spin"),
    [("top", 3, -4.99, 2.53, [0, -300, 0]), ("top", 5, -7.46, 1.68, [0, -400, 0]), ("back", 4, -6.7, 0.41, [0, 323, 0])],
)
def test_shots_are_those_of_the_tables(kind, scale, v_x, v_z, spin):
    rng = np.random.default_rng(1)
    balls = [launch(kind, scale, LauncherParams(), rng)[0] for _ in range(400)]
    # 5 standard errors of the largest printed scatter: 0.15 m/s and 37 rad/s over 400 balls
    assert np.mean([b.velocity[[0, 2]] for b in balls], axis=0) == pytest.approx([v_x, v_z], abs=0.04)
    assert np.mean([b.spin for b in balls], axis=0) == pytest.approx(spin, abs=10.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [3, 4, 5])
def test_every_shot_bounces_once_on_the_robots_half_and_comes_within_reach(kind, scale):
    rng = np.random.default_rng(2)
    for _ in range(20):
        ball, orientation = launch(kind, scale, LauncherParams(), rng)
        path = rollout(ball, Physics.liu(), StopRule.at_x(-0.2))
        assert len(path.bounces) == 1 and 0.0 < path.bounces[0].position[0] < 1.37
        assert path.ended == "stop" and 0.25 < path.end.position[1] < 1.275 and 0.05 < path.end.position[2] < 0.6
        assert orientation @ orientation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_a_seed_gives_its_ball_again():
    one, other = (launch("left", 4, LauncherParams(), np.random.default_rng(7)) for _ in range(2))
    assert one[0].vector == pytest.approx(other[0].vector, abs=0.0)
    assert one[1] == pytest.approx(other[1], abs=0.0)


def test_bad_values_name_themselves():
    with pytest.raises(TtError, match="kind 'smash' is none of top, back, left, right"):
        launch("smash", 3, LauncherParams(), np.random.default_rng(0))
    with pytest.raises(OutOfRange, match=r"scale = 9 is outside \[3, 5\]"):
        launch("top", 9, LauncherParams(), np.random.default_rng(0))
    with pytest.raises(OutOfRange, match="z = 0 is outside"):
        LauncherParams(z=0.0)
