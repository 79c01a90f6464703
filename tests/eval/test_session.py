"""At a rate one arm meets ball after ball, each from where the ones before have left it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tt_eval.episode import play, session
from tt_eval.miss import Miss
from tt_eval.scenario import load
from tt_eval.sweep import simulate_balls
from tt_sim.world.outcome import Result

FAST = replace(load("pace", images=False), session=3)
SLOW = replace(FAST, launcher=replace(FAST.launcher, rate=26.0))


@pytest.fixture(scope="module")
def fast():
    return session(FAST, 1)


def test_balls_come_at_the_rate(fast):
    assert [episode.trial.seed for episode in fast] == [3, 4, 5]
    assert [episode.trial.ball.time for episode in fast] == pytest.approx([0.0, 60 / 94, 120 / 94], abs=1e-12)
    alone = load("liu", images=False)
    for episode in fast:
        assert episode.trial.ball.vector == pytest.approx(play(alone, episode.trial.seed).trial.ball.vector, abs=0.0)


def test_the_arm_is_where_the_last_ball_has_left_it(fast):
    for before, after in pairwise(fast):
        same = np.searchsorted(before.joints[:, 0], after.joints[0, 0] - 1e-9)
        assert before.joints[same] == pytest.approx(after.joints[0], abs=0.0)
    assert np.abs(fast[1].joints[0, 8:]).max() > 0.1  # rad/s: it is still on its way


def test_the_first_ball_meets_an_arm_that_waits():
    first, alone = session(SLOW, 0)[0], play(load("liu", images=False), 0)
    assert first.outcome.result is alone.outcome.result is Result.RETURNED
    # 1e-6 rad/s and m/s, as between the swift swing and the ticks
    assert first.outcome.landing.before.vector == pytest.approx(alone.outcome.landing.before.vector, abs=1e-6)


def test_slow_balls_are_returned_and_most_fast_ones():
    assert [episode.miss for episode in session(SLOW, 2)] == [None, None, None]  # 2.3 s apart; the arm waits again after 2 s
    fast = [episode.miss for number in (0, 1, 2, 3) for episode in session(FAST, number)]  # 0.64 s apart: the arm needs as long to be back
    assert {None, Miss.TOO_LATE} == set(fast)
    assert fast.count(None) >= 9  # of 12; 10 on the day, 8 when the arm does not hurry


def test_a_ball_is_one_of_its_session(fast):
    again = play(FAST, 4)
    assert again.outcome.to_text() == fast[1].outcome.to_text()
    assert again.joints == pytest.approx(fast[1].joints, abs=0.0)


def test_a_sweep_of_sessions_is_the_same_however_it_is_cut():
    whole = simulate_balls(FAST, 0, 6).to_pylist()
    assert str(simulate_balls(FAST, 0, 2).to_pylist() + simulate_balls(FAST, 2, 6).to_pylist()) == str(whole)
    assert [row["seed"] for row in whole] == list(range(6))
