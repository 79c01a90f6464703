"""The measurement's error model says what rendered balls say."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from tt_core.states import BallState
from tt_core.strict_yaml import yaml_names
from tt_eval.episode import Trial
from tt_eval.scenario import HOME, load
from tt_eval.sensor_error_fit import SLOW_SPEED, draw_ball, errors_seen
from tt_eval.sensor_error_model import FULL, SensorErrorModel, brightest, illumination, last_frame, saturated_share
from tt_sim.render import Lamps, Noise, Texture, render
from tt_vision.detection.ball_detection import SATURATED, find_ball
from tt_vision.rig import EXPOSURE, VIEW_CENTRE, high_speed_pair

BALLS = 48  # new ones: the models were fitted to balls 0 to 799


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("name", ["liu", "real"])
def test_the_model_agrees_with_images(name, slow):
    """The catapult's balls of all scales, and slower ones down to rest: all that scenarios play."""
    scenario = load(name)
    model, rows = SensorErrorModel.load(scenario.world.sensor_error_model), []
    for seed in range(4000 + slow, 4000 + slow + 2 * BALLS, 2):
        passes, measured = errors_seen(scenario, seed)
        if measured is not None:
            trial = draw_ball(scenario, seed)
            assert (np.linalg.norm(trial.ball.velocity) < SLOW_SPEED) == slow
            rows.append(measured.error / model.sigmas(trial.ball))
        else:
            assert not passes or model.refused > 0.0
    assert len(rows) > 0.7 * BALLS
    # the mean square over n balls of one normal error is 1 within 5 sqrt(2 / n); heavier tails and few balls: a factor of two
    squares = np.mean(np.square(rows), axis=0)
    assert np.all((squares > 0.4) & (squares < 2.2)), squares


def test_a_burst_ends_when_the_images_say():
    for seed in range(4):
        trial = Trial.drawn(load("liu"), seed)
        expected = last_frame(trial.ball, trial.cameras, trial.physics)
        assert trial.seen()[1].time == pytest.approx(expected, abs=1.2 / 900)  # a frame more or less at the image's border


def test_a_ball_near_a_lamp_is_saturated_in_both_or_in_none():
    """The share at full scale against what `find_ball` says of rendered images, from a lamp outwards."""
    lamps, texture, rng, differ = Lamps(), Texture.drawn(1), np.random.default_rng(0), 0
    light, away = illumination(lamps, texture), np.array([-0.6, 0.7, -0.1])
    shares = []
    for far in np.linspace(0.25, 0.9, 14):
        ball = BallState(0.0, np.array(lamps.lamps[1].position) + far * away / np.linalg.norm(away), [-5.0, 0, 0], [0, -200.0, 0])
        camera = high_speed_pair()[1]
        camera = replace(camera, translation=camera.translation - camera.rotation @ (ball.position - VIEW_CENTRE))
        spot = find_ball(render(camera, ball, np.eye(3), texture, lamps, EXPOSURE, Noise(), rng))
        shares.append(saturated_share(ball.position, camera.position, light))
        differ += (spot.reason is not None) != (shares[-1] > SATURATED)
        assert shares[-1] == 0.0 or brightest(ball.position, light) >= FULL
    assert differ <= 1 and max(shares) > 2 * SATURATED and min(shares) == 0.0


def test_a_fit_finds_the_errors_it_is_given(tmp_path):
    rng = np.random.default_rng(0)
    n, parts = 4000, np.vstack([np.diag([1.0, 2.0, 3.0, 0.5]), np.ones((5, 4))])
    speeds, spins = rng.uniform(2, 14, n), rng.uniform(0, 900, n)
    causes = np.column_stack([np.ones(n), (spins / 300) ** 2, (speeds / 5) ** 2, (speeds / 5) ** 4])
    variances = causes @ parts.T
    model = SensorErrorModel.fitted(rng.standard_normal((n, 9)) * np.sqrt(variances), speeds, spins, 0.0)
    # the causes share what they explain; their sum over the balls is known to 5 sqrt(2 / 4000), and a factor for what one ball weighs
    assert np.median(causes @ model.parts.T / variances, axis=0) == pytest.approx(np.ones(9), abs=0.15)
    model.save(tmp_path / "s.yaml", "found")
    saved = yaml.safe_load((tmp_path / "s.yaml").read_text())
    assert saved["variances"]["velocity_x"] == pytest.approx(model.parts[3], rel=1e-3)


def test_every_model_here_is_a_covariance():
    for name in yaml_names(HOME / "sensor_error_models"):
        model = SensorErrorModel.load(name)
        assert np.linalg.eigvalsh(model.correlation).min() > -1e-2  # rounded to three digits
        assert 0.0 <= model.refused < 0.1
