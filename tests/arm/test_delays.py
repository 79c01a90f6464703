"""Joint states and commands that come late, and a process that is held up again and again: the true arm touches nothing."""

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import clearance
from tt_eval.arm_trial import STROKES_AT, launched_ball_strokes
from tt_sim.world.drive import Drive
from tt_sim.world.plant import Plant

MODEL, TICK, LONG = ArmModel.pa10(), 0.002, 3.0
STATES_LATE, COMMANDS_LATE, STALL = 0.095, 0.02, 0.3  # s at most; joint states that are older are refused


@pytest.mark.parametrize("seed", range(8))
def test_the_arm_touches_nothing_whatever_comes_late(seed):
    rng = np.random.default_rng(seed)
    control, plant, drive = ArmControl(MODEL), Plant(MODEL), Drive(MODEL.limits)
    control.enable(True)
    joints, states, commands = Joints(0.0, MODEL.waiting, np.zeros(7)), deque(), deque()
    change = states_late = commands_late = held_up = 0.0
    ball, moved, room, clear = 0.3, 0.0, np.inf, np.inf
    while (now := joints.time) < LONG:
        if now >= change:
            states_late, commands_late = rng.choice([0.0, 1.0], 2) * rng.uniform(0.0, [STATES_LATE, COMMANDS_LATE])
            change = now + rng.uniform(0.01, 0.2)
            held_up = now + rng.uniform(0.0, STALL) if rng.random() < 0.3 else held_up
        states.append((now + states_late, joints))
        if now >= held_up:
            came = [state for due, state in states if due <= now]
            while states and states[0][0] <= now:
                states.popleft()
            step = control.step(came[-1], now, now) if came else control.watch(now)
            if step is not None:
                commands.append((now + commands_late, step.command.copy()))
            if now >= ball:
                found = launched_ball_strokes(["back", "top"][seed % 2], int(rng.integers(3, 6)), int(rng.integers(1e6)))
                control.take([replace(racket, time=racket.time + now - STROKES_AT) for racket in found])
                ball = now + rng.uniform(0.4, 1.0)
        while commands and commands[0][0] <= now:
            drive.take(commands.popleft()[1], now)
        joints = plant.advance(joints, drive.command(now, TICK, joints.qdot, drive.params.command_timeout), TICK)
        moved = max(moved, np.abs(joints.q - MODEL.waiting).max())
        room = min(room, (joints.q - MODEL.position_limits[:, 0]).min(), (MODEL.position_limits[:, 1] - joints.q).min())
        clear = min(clear, clearance(joints.q, MODEL.bodies)[0])
    assert moved > 0.1  # rad: it plays
    assert room > 0.0 and clear > 0.0  # 0.028 rad and 13 mm at least in 200 runs of 6 s
    assert control.guard.latched is None
