"""With the wide cameras strokes follow the ball until the strike, and each ball teaches the next."""

from dataclasses import replace

import numpy as np
import pytest
from tt_core.errors import TtError
from tt_eval.episode import landing_error, play, session
from tt_eval.scenario import Robot, load
from tt_eval.sweep import simulate_balls
from tt_sim.world.outcome import Result

SCENARIO = replace(load("real", robot="feedback", images=False), session=4)


def switched(**parts):
    return replace(SCENARIO, robot=replace(SCENARIO.robot, **parts))


@pytest.fixture(scope="module")
def balls():
    return session(SCENARIO, 0)


def test_balls_are_followed_to_the_strike(balls):
    for episode in balls:
        assert episode.outcome.result is Result.RETURNED
        times = np.array([response.state.time for response in episode.responses])
        assert (np.diff(times) >= SCENARIO.robot.interval - 1e-9).all()
        strike = episode.selection.swing.strike_time
        assert strike - times[-1] < 2 * SCENARIO.robot.interval  # to the last but one state before it, at least
        bounce = next(contact.before.time for contact in episode.outcome.contacts)
        assert (times > bounce).any()


def test_states_come_closer_to_the_truth(balls):
    for episode in balls:
        off = [
            np.linalg.norm(s.position - episode.outcome.places(np.array([s.time]), episode.trial.physics.air.coefficients)[0])
            for s in (response.state for response in episode.responses)
        ]
        assert off[-1] < 0.005  # m; cameras that are 0.2 pixels aside: 1.4 mm


def test_a_robot_that_learns_lands_nearer():
    scenario = replace(SCENARIO, session=5)
    learning, not_learning = (
        np.median([landing_error(episode) for episode in session(one, 1)[2:] if landing_error(episode) is not None])
        for one in (scenario, replace(scenario, robot=replace(scenario.robot, learning=False)))
    )
    assert learning < not_learning


def test_a_session_is_the_same_again_and_a_ball_one_of_it(balls):
    again = play(SCENARIO, 2)
    assert again.outcome.to_text() == balls[2].outcome.to_text()
    rows = simulate_balls(SCENARIO, 2, 4).to_pylist()
    assert [row["seed"] for row in rows] == [2, 3]


def test_each_part_can_be_switched_off():
    plain = play(switched(feedback=False, learning=False, margin=0.0), 1)
    assert plain.responses == () and plain.measured is not None
    spinless = play(switched(spin="ignored", learning=False), 1)
    assert spinless.responses and all(np.abs(response.state.spin[2]) < 100.0 for response in spinless.responses[:3])
    with pytest.raises(TtError):
        Robot(learning=True)


def test_a_ball_that_only_the_wide_cameras_see_is_returned(monkeypatch):
    monkeypatch.setattr("tt_eval.episode.Trial.guessed", lambda self: None)
    played = [play(switched(learning=False), seed) for seed in range(4)]
    assert all(episode.measured is None and episode.responses for episode in played)
    assert any(episode.outcome.hit for episode in played)
