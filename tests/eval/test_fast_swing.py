"""The swing in one call is the swing tick by tick."""

from dataclasses import replace

import numpy as np
import pytest
import tt_eval.episode as module
from tt_eval.episode import play
from tt_eval.scenario import load


@pytest.mark.parametrize("seed", range(6))
def test_it_plays_what_the_ticks_play(seed, monkeypatch):
    scenario = load("liu", images=False)
    swift = play(scenario, seed)
    monkeypatch.setattr(module, "_swiftly", lambda *_: None)
    ticks = play(scenario, seed)
    assert swift.reason == ticks.reason
    for one, other in zip(swift.outcome.contacts[:3], ticks.outcome.contacts[:3], strict=True):
        assert one.surface == other.surface
        assert one.after.vector == pytest.approx(other.after.vector, abs=1e-6)  # rad/s and m/s: contacts to rounding, 1e-10 m
    last = swift.joints[-1]
    at = np.argmin(np.abs(ticks.joints[:, 0] - last[0]))
    assert ticks.joints[at] == pytest.approx(last, abs=1e-9)


def test_without_torque_the_ticks_are_played(monkeypatch):
    scenario, ticked = load("liu", images=False), []
    original = module._tick_by_tick
    monkeypatch.setattr(module, "_tick_by_tick", lambda *args: ticked.append(1) or original(*args))
    play(scenario, 0)
    assert not ticked
    play(replace(scenario, world=replace(scenario.world, plant=replace(scenario.world.plant, torque_share=0.05))), 0)
    assert ticked
