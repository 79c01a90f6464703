"""What cameras and trials get wrong is what the world says."""

from dataclasses import replace

import numpy as np
import pytest
from tt_core.physics import Physics
from tt_eval.episode import Trial
from tt_eval.scenario import load
from tt_sim.cameras.camera_faults import CameraFaults, arrivals
from tt_sim.cameras.camera_sequence import Frame
from tt_sim.domain_randomization import DomainRandomization

FRAMES = [Frame(0.1 + i / 900, (np.zeros((2, 2), np.uint8),) * 2) for i in range(2000)]


def test_the_perfect_camera_changes_nothing():
    got = list(arrivals(FRAMES[:5], CameraFaults(), np.random.default_rng(0)))
    assert [(side, stamp) for side, stamp, _ in got] == [(side, frame.time) for frame in FRAMES[:5] for side in (0, 1)]


def test_frames_are_lost_doubled_and_stamped_wrongly():
    faults = CameraFaults(jitter=1e-5, clock_offset=0.5, apart=1e-3, dropped=0.1, duplicated=0.05)
    got = list(arrivals(FRAMES, faults, np.random.default_rng(0)))
    # of 4000 images, 5 standard deviations: 95 lost, 70 doubled
    assert len(got) == pytest.approx(4000 * 0.9 * 1.05, abs=5 * np.sqrt(4000 * (0.1 * 0.9 + 0.05)))
    left, right = (np.array([stamp for side, stamp, _ in got if side == which]) for which in (0, 1))
    assert np.mean(right) - np.mean(left) == pytest.approx(1e-3, abs=0.1)
    off = (left - 0.6) * 900 - np.round((left - 0.6) * 900)
    assert np.std(off) / 900 == pytest.approx(1e-5, rel=0.15)


def test_trials_differ_as_much_as_the_world_says():
    world, rng = load("real").world, np.random.default_rng(0)
    drawn = [world.domain_randomization.draw(world.physics, rng) for _ in range(500)]
    for name, values in {
        "drag": [p.air.drag / world.physics.air.drag for p in drawn],
        "lift": [p.air.lift_ratio / world.physics.air.lift_ratio for p in drawn],
        "friction": [p.table.friction / world.physics.table.friction for p in drawn],
    }.items():
        assert np.mean(values) == pytest.approx(1.0, abs=5 * getattr(world.domain_randomization, name) / np.sqrt(500))
        assert np.std(values) == pytest.approx(getattr(world.domain_randomization, name), rel=0.16)  # 5 / sqrt(2 n)


def test_balls_of_a_session_vary_about_it():
    world = load("real").world
    sessions = [world.of_session(number) for number in range(300)]
    drags = np.array([one.physics.air.drag for one in sessions]) / world.physics.air.drag
    assert np.std(drags) == pytest.approx(world.session_randomization.drag, rel=0.21)  # 5 / sqrt(2 n)
    assert sessions[7] == world.of_session(7) != sessions[8]
    balls = [Trial.drawn(replace(load("real"), session=50), seed).physics.air.drag for seed in range(100)]
    for number, part in enumerate((balls[:50], balls[50:])):
        mean, spread = sessions[number].physics.air.drag, world.domain_randomization.drag
        assert np.mean(part) == pytest.approx(mean, rel=5 * spread / np.sqrt(50))
        assert np.std(part) == pytest.approx(mean * spread, rel=0.5)  # 5 / sqrt(2 n)


def test_without_variation_a_trial_is_the_world():
    physics = Physics.measured()
    assert DomainRandomization().draw(physics, np.random.default_rng(0)) == replace(physics)
