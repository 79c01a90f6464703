"""The catapult shoots what its tables say, and nothing else."""

import numpy as np
import pytest
from tt_core.constants import RPM
from tt_core.errors import BadChoice, OutOfRange
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.rollout import StopRule, rollout
from tt_sim.world.launcher import LANDING_X, SHOT_KINDS, LauncherParams, launch, shot_row


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


@pytest.mark.parametrize("kind", SHOT_KINDS)
@pytest.mark.parametrize("scale", [3, 4, 5])
def test_every_shot_bounces_once_on_the_robots_half_and_comes_within_reach(kind, scale):
    rng = np.random.default_rng(2)
    for _ in range(20):
        ball, orientation = launch(kind, scale, LauncherParams(), rng)
        path = rollout(ball, Physics.liu(), StopRule.at_x(-0.2))
        assert len(path.bounces) == 1 and 0.0 < path.bounces[0].position[0] < 1.37
        assert path.ended == "stop" and 0.25 < path.end.position[1] < 1.275 and 0.05 < path.end.position[2] < 0.6
        assert orientation @ orientation.T == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("kind", SHOT_KINDS)
def test_scales_without_a_row_go_on_as_the_rows_do(kind):
    rows = [shot_row(kind, scale) for scale in range(1, 11)]
    assert np.all(np.diff([r[0][0] for r in rows]) < 0.0) and np.all(np.diff([r[2][0] for r in rows]) > 0.0)  # faster, more spin
    axis = launch(kind, 3, LauncherParams(axis_scatter=0.0), np.random.default_rng(1))[0].spin
    for scale in (1, 2, 6, 7, 8, 9, 10):
        (v_x, _), (v_z, _), (spin, _) = shot_row(kind, scale)
        ball = BallState(0.0, [LauncherParams.x, LauncherParams.y, LauncherParams.z], [v_x, 0, v_z], spin * axis / np.linalg.norm(axis))
        path = rollout(ball, Physics.liu(), StopRule.at_landing())
        if path.end.position[0] != pytest.approx(LANDING_X, abs=1e-6):  # then it only just clears the net: 1 mm/s lower it does not
            lower = BallState(0.0, ball.position, ball.velocity - [0, 0, 1e-3], ball.spin)
            assert path.end.position[0] < LANDING_X and rollout(lower, Physics.liu(), StopRule.at_landing()).ended == "net"


@pytest.mark.parametrize("kind", SHOT_KINDS)
def test_extrapolated_scales_are_balls_that_are_played(kind):
    rows = np.array([shot_row(kind, scale) for scale in range(1, 11)])
    speed, spin = np.hypot(rows[:, 0, 0], rows[:, 1, 0]), rows[:, 2, 0]
    assert np.all(np.diff(speed[1:]) > 0.0) and 4.5 < speed.min() < speed[0] < 6.5 and 13.0 < speed.max() < 14.0  # m/s; scale 1 is a lob
    assert spin.min() > 180.0 and spin.max() < 9129 * RPM  # rad/s, the most in match play
    assert np.array_equal(rows[:2, :, 1], rows[[2, 2], :, 1]) and np.array_equal(rows[5:, :, 1], rows[[4] * 5, :, 1])  # scatter


def test_mixed_is_all_kinds():
    rng = np.random.default_rng(3)
    spins = np.array([launch("mixed", 4, LauncherParams(), rng)[0].spin for _ in range(60)])
    assert {(int(np.argmax(np.abs(w))), bool(w[np.argmax(np.abs(w))] > 0)) for w in spins} == {(1, False), (1, True), (2, False), (2, True)}


def test_a_seed_gives_its_ball_again():
    one, other = (launch("left", 4, LauncherParams(), np.random.default_rng(7)) for _ in range(2))
    assert one[0].vector == pytest.approx(other[0].vector, abs=0.0)
    assert one[1] == pytest.approx(other[1], abs=0.0)


def test_bad_values_name_themselves():
    with pytest.raises(BadChoice) as choice:
        launch("smash", 3, LauncherParams(), np.random.default_rng(0))
    assert (choice.value.name, choice.value.value, choice.value.choices) == ("kind", "smash", SHOT_KINDS)
    for make, wrong in (
        (lambda: launch("top", 11, LauncherParams(), np.random.default_rng(0)), ("scale", 11, 1, 10)),
        (lambda: LauncherParams(rate=-3), ("rate", -3, 26, 94)),
        (lambda: LauncherParams(z=0.0), ("z", 0.0, 0.05, 1.5)),
    ):
        with pytest.raises(OutOfRange) as error:
            make()
        assert (error.value.name, error.value.value, error.value.low, error.value.high) == wrong
