"""Coefficients come back from flights that were made with them; real launches land where the identified model says."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from refusals import check_named
from tt_core.errors import BadChoice
from tt_core.flight import Aerodynamics
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.identify import NoFlights, Predictor, identify, main, with_coefficients, write_parameters
from tt_predict.landings import landing, up_to_landing
from tt_predict.recordings import BALL_ROW, BadTimes, Flight, aimy, cut, load_flights
from tt_predict.rollout import StopRule, rollout
from tt_predict.validate import predicted_landing_error, validate

TRUE = with_coefficients(Physics.liu(), ["air.drag", "air.lift", "table.restitution"], [0.44, 0.11, 0.9])


def flights(count, noise, seed=0, known_spin=True):
    """Launches of TRUE seen at 150 Hz, as in (3.29)."""
    rng = np.random.default_rng(seed)
    made = []
    for i in range(count):
        kind = (-350.0, 300.0)[i % 2]
        velocity = [rng.uniform(-7, -5), rng.uniform(-0.3, 0.3), rng.uniform(0.8, 1.5)]
        spin = np.array([0.0, kind, 0.0])
        ball = BallState(0.0, [2.6, 0.76, 0.4], velocity, spin)
        times = np.arange(90) / 150.0
        positions = Predictor(TRUE).positions(ball.vector, times) + rng.normal(0.0, noise, (90, 3))
        made.append(Flight(f"kind {i % 2}", times, positions, spin if known_spin else None))
    return made


def test_a_predictor_is_rollout():
    ball = BallState(0.3, [2.6, 0.76, 0.3], [-6.2, 0.1, 1.0], [20, -360, 30])
    times = np.linspace(0.3, 0.85, 57)
    path = rollout(ball, Physics.liu(), StopRule.at_time(0.9))
    # 1e-7 m: what BallPath promises between its points
    assert Predictor(Physics.liu()).positions(ball.vector, times) == pytest.approx(np.array([path.at(t).position for t in times]), abs=1e-7)


def test_exact_flights_give_their_coefficients_back():
    found = identify(flights(4, 0.0), Physics.liu(), ["air.drag", "air.lift", "table.restitution"])
    assert found.values == pytest.approx([0.44, 0.11, 0.9], abs=1e-5)
    assert found.rms[1] < 1e-5 < found.rms[0]


def test_the_intervals_hold_the_truth():
    """95 % of 30 trials of two coefficients: 57 of 60; bound at 50, as 40 flights are few for a sandwich."""
    inside = 0
    for seed in range(30):
        found = identify(flights(8, 2e-3, seed), Physics.liu(), ["air.drag", "air.lift"])
        inside += int((np.abs(found.values - [0.44, 0.11]) < found.intervals).sum())
    assert inside >= 50


def test_spin_that_was_not_measured_is_found_for_each_group():
    found = identify(flights(4, 0.0, known_spin=False), TRUE, [])
    assert found.spins["kind 0"][0] == pytest.approx(350.0, abs=1.0)
    assert found.spins["kind 1"][0] == pytest.approx(-300.0, abs=1.0)


def test_a_recorded_landing_is_where_the_ball_bounced():
    for flight in flights(6, 0.0):
        state = Predictor(TRUE).start(flight, flight.spin, 60)
        path = rollout(BallState.from_vector(0.0, state), TRUE, StopRule.at_landing())
        if path.ended is not PathEnd.STOP:
            assert landing(flight) is None
            continue
        bounce, (time, place) = path.end, landing(flight)
        # a parabola through 10 points of 150 Hz
        assert time == pytest.approx(bounce.time, abs=1e-4)
        assert place == pytest.approx(bounce.position[:2], abs=1e-3)
        assert up_to_landing(flight).times[-1] < time
        assert max(predicted_landing_error(flight, TRUE, flight.spin)) < 1e-3


def test_rows_are_cut_into_flights():
    def rows(times, v_x):
        return np.array([(time, (0.5, 0.5, 0.5), v_x, (7.0, 7.0, 7.0)) for time in times], BALL_ROW)

    t = np.arange(20) / 100.0
    cutting = cut(
        np.concatenate([rows(t, -5.0), rows(t + 0.2, 4.0), rows(t + 0.4, -5.0), rows(t + 5.0, -5.0), rows(t[:3] + 9.0, -5.0)]), "g"
    )
    assert [(f.times[0], len(f.times)) for f in cutting] == [(0.0, 20), (0.4, 20), (5.0, 20)]
    assert cutting[0].spin == pytest.approx([7.0, 7.0, 7.0])
    assert cut(np.empty(0, BALL_ROW), "g") == []


def test_a_bag_gives_the_coefficients_of_the_balls_in_it(tmp_path, capsys):
    from rclpy.serialization import serialize_message
    from tt_core.ros.convert import ball_to_message
    from tt_tools.record import Recording

    recording = Recording(tmp_path / "bag")
    recording.add_topic("/ball/state", "nav_msgs/msg/Odometry", [])
    for i, velocity in enumerate(([-6.2, 0.1, 1.2], [-5.4, -0.1, 1.5])):
        path = rollout(BallState(1.0 + 3 * i, [2.6, 0.76, 0.4], velocity, [0, -350, 0]), TRUE, StopRule.at_x(0.0))
        for time in np.arange(path.times[0], path.times[-1], 1 / 150):
            recording.add("/ball/state", int(1e9 * time), serialize_message(ball_to_message(path.at(time))))
    recording.close()
    assert len(load_flights(tmp_path / "bag", "/ball/state")) == 2
    assert main([str(tmp_path / "bag"), "--output", str(tmp_path / "found.yaml")]) == 0
    assert "air.drag" in capsys.readouterr().out
    values = yaml.safe_load((tmp_path / "found.yaml").read_text())["/**/predict"]["ros__parameters"]
    assert values["physics"] == "liu"
    # one kind of spin: the bag tells lift and drag apart by the shape of the path only
    assert values["air.drag"] == pytest.approx(0.44, abs=2e-3)
    assert values["air.lift"] == pytest.approx(0.11, abs=2e-3)


def test_parameters_are_written_to_all_digits(tmp_path):
    found = identify(flights(2, 0.0), Physics.liu(), ["air.drag"])
    write_parameters(found, "liu", tmp_path / "p.yaml")
    values = yaml.safe_load((tmp_path / "p.yaml").read_text())["/**/predict"]["ros__parameters"]
    assert Aerodynamics(drag=values["air.drag"]) == found.physics.air


def test_bad_input_names_itself(tmp_path, capsys):
    with pytest.raises(BadChoice) as error:
        identify(flights(2, 0.0), Physics.liu(), ["air.mass"])
    assert (error.value.name, error.value.value) == ("coefficient", "air.mass") and "air.drag" in error.value.choices
    with pytest.raises(NoFlights):
        identify([], Physics.liu(), ["air.drag"])
    with pytest.raises(BadTimes):
        Flight("g", [1.0, 1.0], np.zeros((2, 3)))
    assert main([str(tmp_path / "nothing")]) == 2
    assert main([str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    check_named(errors, tmp_path / "nothing", "*.mcap", "*.db3", "*.bag")


@pytest.mark.skipif("TT_DATA_DIR" not in os.environ, reason="TT_DATA_DIR does not name the folder of recorded launches")
def test_real_launches_land_where_the_identified_model_says():
    launches = aimy(Path(os.environ["TT_DATA_DIR"]) / "aimy")
    assert len(launches) == 88
    errors = validate(launches)
    medians = {
        name: np.median(np.concatenate([pairs for (_, model), pairs in errors.items() if model == name])[:, 0])
        for name in ("gravity only", "liu as printed", "identified")
    }
    # m; 0.101, 0.037 and 0.012 on the day
    assert medians["identified"] < 0.02 < medians["liu as printed"] < 0.06 < medians["gravity only"]
