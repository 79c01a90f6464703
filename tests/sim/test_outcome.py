"""What became of a ball is read from its contacts."""

import pytest
from tt_core.states import BallState
from tt_sim.world.outcome import Outcome, Result
from tt_sim.world.true_ball import Contact, Surface


def contact(surface, x, time):
    ball = BallState(time, [x, 0.7, 0.02], [1, 0, 0], [0, 0, 0])
    return Contact(surface, ball, ball)


BOUNCE, HIT = contact(Surface.TABLE, 0.5, 0.3), contact(Surface.RACKET, -0.2, 0.5)


@pytest.mark.parametrize(
    ("contacts", "result"),
    [
        ([], Result.MISSED),
        ([BOUNCE], Result.MISSED),
        ([BOUNCE, HIT], Result.FLYING),
        ([BOUNCE, HIT, contact(Surface.TABLE, 2.0, 1.1)], Result.RETURNED),
        ([BOUNCE, HIT, contact(Surface.TABLE, 0.4, 1.1)], Result.OWN_HALF),
        ([BOUNCE, HIT, contact(Surface.NET, 1.37, 1.0)], Result.NET),
        ([BOUNCE, HIT, contact(Surface.FLOOR, 3.5, 1.2)], Result.OFF_TABLE),
        ([BOUNCE, contact(Surface.FLOOR, -1.0, 0.9)], Result.MISSED),
        ([BOUNCE, contact(Surface.TABLE, 0.1, 0.4), HIT, contact(Surface.TABLE, 2.0, 1.1)], Result.DOUBLE_BOUNCE),
        ([BOUNCE, HIT, contact(Surface.NET, 1.37, 1.0), contact(Surface.TABLE, 1.5, 1.1)], Result.RETURNED),
        ([BOUNCE, HIT, contact(Surface.NET, 1.37, 1.0), contact(Surface.TABLE, 1.2, 1.1)], Result.NET),
        ([BOUNCE, HIT, contact(Surface.NET, 1.37, 1.0), contact(Surface.FLOOR, 1.2, 1.1)], Result.NET),
    ],
)
def test_results(contacts, result):
    assert Outcome(BOUNCE.before, contacts).result is result


def test_a_result_is_shown_as_its_word():
    assert f"{Result.OWN_HALF}" == str(Result.OWN_HALF) == "own half" and Result("own half") is Result.OWN_HALF
    assert Outcome(BOUNCE.before).to_text()["result"] == "missed"


def test_a_ball_is_over_when_it_is_gone_or_landed():
    outcome = Outcome(BOUNCE.before, [BOUNCE, HIT])
    flying = BallState(0.9, [1.0, 0.7, 0.4], [4, 0, 0], [0, 0, 0])
    assert not outcome.over(flying, 0.9)
    assert outcome.over(None, 0.9)
    outcome.contacts.append(contact(Surface.TABLE, 2.0, 1.1))
    assert not outcome.over(flying, 1.15)
    assert outcome.over(flying, 1.25)
