"""A ball played without ROS: returned, the same again by its seed, and every failure with its reason."""

import pytest
from tt_arm.swing import SwingFailure
from tt_core.errors import BadChoice, OutOfRange
from tt_core.states import ReturnGoal
from tt_eval.episode import landing_error, play, spin_error
from tt_eval.failures import EpisodeFailure
from tt_eval.miss import Miss
from tt_eval.scenario import Robot, Scenario
from tt_racket.failures import StrokeFailure
from tt_racket.intercept import InterceptParams
from tt_sim.world.outcome import Result


@pytest.mark.parametrize(("kind", "scale"), [("top", 4), ("back", 3), ("left", 3)])
def test_balls_come_back(kind, scale):
    episode = play(Scenario(kind, scale), seed=1)
    assert episode.reason is None
    assert landing_error(episode) < 0.10  # m; 3 cm at most in 36 balls on the day
    assert spin_error(episode) < 31.4  # rad/s, 300 rpm; 1.2 at most on the day
    assert episode.outcome.hit.after.spin[1:] == pytest.approx([episode.goal.spin_y, episode.goal.spin_z], abs=20.0)  # rad/s, as asked


def test_a_seed_gives_its_episode_again():
    one, other = (play(Scenario("top", 3), seed=4) for _ in range(2))
    assert one.joints == pytest.approx(other.joints, abs=0.0)
    assert one.outcome.landing.before.vector == pytest.approx(other.outcome.landing.before.vector, abs=0.0)


def test_a_goal_is_asked_for():
    goal = ReturnGoal([1.8, 0.6], 0.55, 60.0, 0.0)
    episode = play(Scenario("top", 3, goal=goal), seed=2)
    assert episode.goal is goal
    assert episode.outcome.landing.before.position[:2] == pytest.approx(goal.landing, abs=0.10)  # m, as above


@pytest.mark.parametrize(
    ("window", "code", "miss"),
    [
        (InterceptParams(z_low=2.0, z_high=3.0), StrokeFailure.NO_HIT_POINT, Miss.OUT_OF_REACH),
        (InterceptParams(racket_speed=0.1), StrokeFailure.RACKET_TOO_FAST, Miss.RACKET_TOO_SLOW),
    ],
)
def test_a_failure_has_its_reason(window, code, miss):
    episode = play(Scenario("top", 4, robot=Robot(intercept=window)), seed=0)
    assert episode.reason.code is EpisodeFailure.NO_STROKE
    assert code in {failure.code for failure in episode.reason.values["causes"]}
    assert episode.outcome.result is not Result.RETURNED and episode.miss is miss


@pytest.mark.parametrize("latency", [0.4, 1.5])
def test_an_arm_that_is_told_too_late_has_its_reason(latency):
    episode = play(Scenario("top", 4, robot=Robot(latency=latency)), seed=0)
    assert episode.reason.code is EpisodeFailure.NO_SWING
    assert episode.reason.values["cause"].failure.code is SwingFailure.TOO_SOON
    assert episode.miss is Miss.TOO_LATE and episode.outcome.result is Result.MISSED


def test_a_scenario_that_cannot_be_is_refused():
    with pytest.raises(BadChoice) as error:
        Scenario("lob")
    assert (error.value.name, error.value.value) == ("kind", "lob")
    with pytest.raises(OutOfRange) as error:
        Robot(latency=-1.0)
    assert (error.value.name, error.value.value) == ("latency", -1.0)
