"""Arm and ball together: the ball flies from its own time on, meets the racket, and is over once."""

import numpy as np
import pytest
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_sim.simulated_robot import SimulatedRobot
from tt_sim.world.plant import Plant
from tt_sim.world.true_ball import Surface

MODEL, PHYSICS, TICK = ArmModel.pa10(), Physics.liu(), 0.002


def hardware():
    return SimulatedRobot(PHYSICS, Plant(MODEL), Joints(10.0, MODEL.waiting, np.zeros(7)), TICK)


def test_a_ball_flies_from_its_own_time_on():
    machine = hardware()
    ball = BallState(10.0131, [2.6, 0.76, 0.4], [-5.0, 0, 1.0], [0, -300, 0])
    machine.launch(ball)
    ticks = [machine.advance(np.zeros(7)) for _ in range(50)]
    assert [tick.ball is None for tick in ticks] == [tick.joints.time < ball.time for tick in ticks]
    end = ticks[-1].ball
    assert end.vector == pytest.approx(fly(ball.vector, end.time - ball.time, PHYSICS.air.coefficients), abs=1e-6)


def test_a_ball_onto_the_waiting_racket_is_a_hit_and_is_over_once():
    machine = hardware()
    position, rotation = MODEL.racket(MODEL.waiting)
    start = position + 0.3 * rotation[:, 2] + [0, 0, 0.02]
    machine.launch(BallState(10.0, start, -6.0 * rotation[:, 2], [0, 0, 0]))
    ticks = [machine.advance(np.zeros(7)) for _ in range(1500)]
    assert machine.outcome.hit is not None and machine.outcome.contacts[0].surface is Surface.RACKET
    assert [outcome for tick in ticks for outcome in tick.ended] == [machine.outcome]
    assert ticks[-1].ball is None
    values = machine.outcome.to_text()
    assert values["result"] == machine.outcome.result and values["hit"].startswith("[10.0")


def test_balls_in_flight_together_each_have_their_outcome():
    machine = hardware()
    first, second = (BallState(10.0 + t, [2.6, 0.76, 0.4], [-5.0, 0, 1.0], [0, -300, 0]) for t in (0.001, 0.401))
    machine.launch(first)
    ticks = [machine.advance(np.zeros(7)) for _ in range(200)]
    machine.launch(second)
    ticks += [machine.advance(np.zeros(7)) for _ in range(1500)]
    ended = [outcome for tick in ticks for outcome in tick.ended]
    assert [outcome.launched.time for outcome in ended] == [first.time, second.time]
    one, other = (outcome.contacts[0] for outcome in ended)
    assert other.before.time - one.before.time == pytest.approx(0.4, abs=1e-9)
    assert other.before.vector == pytest.approx(one.before.vector, abs=1e-9)


def test_commands_move_the_joints():
    machine = hardware()
    for _ in range(100):
        tick = machine.advance(np.array([0, 0, 0, 0, 0, 0, 1.0]))
    assert tick.joints.time == pytest.approx(10.2)
    assert tick.joints.qdot == pytest.approx([0, 0, 0, 0, 0, 0, 1.0], abs=1e-9)
