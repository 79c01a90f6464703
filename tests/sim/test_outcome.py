"""What became of a ball is read from its contacts."""

import pytest
from tt_core.states import BallState
from tt_sim.world.outcome import Outcome
from tt_sim.world.true_ball import Contact


def contact(surface, x, time):
    ball = BallState(time, [x, 0.7, 0.02], [1, 0, 0], [0, 0, 0])
    return Contact(surface, ball, ball)


BOUNCE, HIT = contact("table", 0.5, 0.3), contact("racket", -0.2, 0.5)


@pytest.mark.parametrize(
    ("contacts", "result"),
    [
        ([], "missed"),
        ([BOUNCE], "missed"),
        ([BOUNCE, HIT], "flying"),
        ([BOUNCE, HIT, contact("table", 2.0, 1.1)], "returned"),
        ([BOUNCE, HIT, contact("table", 0.4, 1.1)], "own half"),
        ([BOUNCE, HIT, contact("net", 1.37, 1.0)], "net"),
        ([BOUNCE, HIT, contact("floor", 3.5, 1.2)], "off the table"),
        ([BOUNCE, contact("floor", -1.0, 0.9)], "missed"),
        ([BOUNCE, contact("table", 0.1, 0.4), HIT, contact("table", 2.0, 1.1)], "double bounce"),
        ([BOUNCE, HIT, contact("net", 1.37, 1.0), contact("table", 1.5, 1.1)], "returned"),
        ([BOUNCE, HIT, contact("net", 1.37, 1.0), contact("table", 1.2, 1.1)], "net"),
        ([BOUNCE, HIT, contact("net", 1.37, 1.0), contact("floor", 1.2, 1.1)], "net"),
    ],
)
def test_results(contacts, result):
    assert Outcome(BOUNCE.before, contacts).result == result


def test_a_ball_is_over_when_it_is_gone_or_landed():
    outcome = Outcome(BOUNCE.before, [BOUNCE, HIT])
    flying = BallState(0.9, [1.0, 0.7, 0.4], [4, 0, 0], [0, 0, 0])
    assert not outcome.over(flying, 0.9)
    assert outcome.over(None, 0.9)
    outcome.contacts.append(contact("table", 2.0, 1.1))
    assert not outcome.over(flying, 1.15)
    assert outcome.over(flying, 1.25)
