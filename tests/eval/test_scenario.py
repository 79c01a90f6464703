"""Scenarios are read strictly: what is there can be played, what is wrong is told by its path in the file."""

from dataclasses import astuple, fields, replace
from pathlib import Path

import pytest
import yaml
from arm.own_urdfs import EIGHT
from tt_core.errors import BadChoice, BadShape, NotFinite, OutOfRange, TtError
from tt_core.physics import Physics
from tt_core.strict_yaml import BadFile, MissingKey, UnknownKey, Unreadable, WrongType, yaml_names
from tt_eval.episode import play
from tt_eval.scenario import HOME, Scenario, load
from tt_sim.cameras.camera_faults import CameraFaults
from tt_sim.cameras.tracking_cameras import TrackingCameraFaults
from tt_sim.domain_randomization import DomainRandomization
from tt_sim.world.launcher import SHOT_KINDS
from tt_sim.world.plant import PlantParams
from tt_sim.world_file import WORLDS

FAILURES = {"late", "outliers", "outlier_distance", "dead"}  # that no profile has; `scripts/bench feedback` plays them
PROFILES = {"ideal", "liu", "real", "harsh"}


def test_every_scenario_world_and_robot_here_can_be_read():
    assert set(yaml_names(HOME / "scenarios")) >= PROFILES
    assert {load("liu", robot=robot).robot.stroke for robot in yaml_names(HOME / "robots")} == {"exact", "sam", "specular"}
    for scenario in [load(name) for name in yaml_names(HOME / "scenarios")]:
        assert isinstance(scenario, Scenario)
    for world in yaml_names(WORLDS):
        load("liu", world=world)


def test_every_profile_names_every_fault():
    """Zero where it has none, so that a reader sees what there is; `real` and `harsh` have them all."""
    kinds = {
        "session_randomization": DomainRandomization,
        "domain_randomization": DomainRandomization,
        "cameras": CameraFaults,
        "tracking_cameras": TrackingCameraFaults,
        "plant": PlantParams,
    }
    for name in PROFILES:
        content = yaml.safe_load((WORLDS / f"{name}.yaml").read_text())
        for part, kind in kinds.items():
            assert set(content[part]) == {field.name for field in fields(kind)} - FAILURES, (name, part)
            if name in ("real", "harsh"):
                assert all(value > 0.0 for value in content[part].values()), (name, part)


def test_profiles_hold_what_they_say():
    ideal, liu, real, harsh = (load(name) for name in ("ideal", "liu", "real", "harsh"))
    assert liu.world.physics == liu.robot.physics == Physics.liu()
    assert real.world.physics == real.robot.physics == Physics.measured()
    assert ideal.world.cameras == liu.world.cameras == CameraFaults()
    assert (
        real.world.domain_randomization.lift < harsh.world.domain_randomization.lift
        and real.world.cameras.dropped < harsh.world.cameras.dropped
    )
    spreads = astuple(real.world.session_randomization)
    assert astuple(real.world.domain_randomization) == pytest.approx([0.2 * spread for spread in spreads])
    by_ball = load("real", world="real_by_ball").world
    assert by_ball == replace(real.world, session_randomization=DomainRandomization(), domain_randomization=DomainRandomization(*spreads))


@pytest.mark.parametrize(
    ("content", "path", "cause"),
    [
        ({"launcher": {"rate": -3}}, "launcher.rate", OutOfRange("rate", -3, 26, 94)),
        ({"launcher": {"rte": 30}}, "launcher.rte", UnknownKey),
        ({"robot": {"latency": "soon"}}, "robot.latency", WrongType),
        ({"robot": {"intercept": {"spacing": 0}}}, "robot.intercept.spacing", OutOfRange),
        ({"world": {"physics": {"model": "measured", "air": {"drag": 9.0}}}}, "world.physics.air.drag", OutOfRange("drag", 9, 0, 2)),
        ({"world": {"physics": "newton"}}, "world.physics.model", BadChoice),
        ({"world": {"physics": {"lift": 1.0}}}, "world.physics.lift", UnknownKey),
        ({"world": {"physics": {"contact_height": 0.0}}}, "world.physics.contact_height", OutOfRange),
        ({"world": {"cameras": {"dropped": 1.5}}}, "world.cameras.dropped", OutOfRange("dropped", 1.5, 0, 1)),
        ({"world": {"domain_randomization": {"drag": -0.1}}}, "world.domain_randomization.drag", OutOfRange),
        ({"world": {"plant": {"time_constant": float("nan")}}}, "world.plant.time_constant", NotFinite),
        ({"world": {"plant": {"q_step": True}}}, "world.plant.q_step", WrongType),
        ({"scale": [3, 11]}, "scale", OutOfRange("scale", 11, 1, 10)),
        ({"scale": [3, "4"]}, "scale[1]", WrongType),
        ({"scale": 10**30}, "scale", WrongType),
        ({"kind": "lob"}, "kind", BadChoice),
        ({"name": "mine"}, "name", UnknownKey),
        ({"shots": "given"}, "", TtError),
        (
            {"shots": "given", "images": False, "ball": {"position": [2.6, 0.7, 0.3], "velocity": [-17, 0, 0], "spin": [0, 0, 0]}},
            "speed of the ball without images",
            OutOfRange("speed of the ball without images", 17, 0, 16),
        ),
        ({"session": 1, "launcher": {"rate": 60}}, "session", OutOfRange("session", 1, 2, 1000)),
        ({"shots": "rotation", "launcher": {"rate": 60}}, "", TtError),
        ({"world": {"tracking_cameras": {"noise": -0.1}}}, "world.tracking_cameras.noise", OutOfRange("noise", -0.1, 0, 10)),
        ({"goal": {"landing": [2.0], "flight_time": 0.5, "spin_y": 0, "spin_z": 0}}, "goal.landing", BadShape),
        ({"goal": {"landing": [2.0, 0.7], "flight_time": 0.5, "spin_y": 0}}, "goal.spin_z", MissingKey),
        ("a word", "", WrongType),
    ],
)
def test_what_is_wrong_is_told_by_its_path(content, path, cause, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(BadFile) as error:
        load(str(file))
    assert error.value.file == "mine.yaml"
    (problem,) = error.value.problems
    assert problem.path == path
    assert str(error.value).startswith(f"mine.yaml: {path}: " if path else "mine.yaml: ")
    if isinstance(cause, OutOfRange):
        assert (problem.cause.value, problem.cause.low, problem.cause.high) == (cause.value, cause.low, cause.high)
    else:
        assert isinstance(problem.cause, cause)


def test_every_wrong_value_is_told_at_once(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("launcher: {rate: -3, z: 9, rte: 1}\nrobot: {latency: soon, intercept: {spacing: 0}}\ntick: true")
    with pytest.raises(BadFile) as error:
        load(str(file))
    wrong = {"launcher.rte", "launcher.rate", "launcher.z", "robot.latency", "robot.intercept.spacing", "tick"}
    assert {p.path for p in error.value.problems} == wrong
    file.write_text("launcher: {rate: -3, z: 9}")
    with pytest.raises(BadFile) as error:
        load(str(file))
    assert [p.path for p in error.value.problems] == ["launcher.rate", "launcher.z"]
    assert str(error.value).splitlines()[0] == "mine.yaml: launcher.rate: -3 is outside [26, 94]"


@pytest.mark.parametrize(
    "text",
    [
        "launcher:\n  rate: 30\n  rate: 60\n",
        "a: [1, 2",
        "? {a: 1}\n: 2",
        "scale: !!int ''",
        "2001-99-99: 1",
        "kind: !!python/object:os.system x",
    ],
)
def test_a_file_that_is_no_yaml_is_refused(text, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(BadFile) as error:
        load(str(file))
    assert error.value.file == "mine.yaml" and isinstance(error.value.problems[0].cause, Unreadable)


@pytest.mark.parametrize("content", [{"world": "mars"}, {"robot": "mars"}])
def test_a_file_that_is_not_there_is_refused_by_its_name(content, tmp_path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content))
    for name, missing in ((tmp_path / "mine.yaml", "mars"), (tmp_path / "other.yaml", str(tmp_path / "other.yaml"))):
        with pytest.raises(BadFile) as error:
            load(str(name))
        assert error.value.file == missing and isinstance(error.value.problems[0].cause, Unreadable)


def test_a_scenario_names_files_beside_it(tmp_path):
    (tmp_path / "moon.yaml").write_text("physics: {model: liu, air: {gravity: 1.6}}")
    (tmp_path / "mine.yaml").write_text("world: moon.yaml\nscale: 4")
    scenario = load(str(tmp_path / "mine.yaml"))
    assert scenario.world.physics.air.gravity == 1.6 and scenario.robot.physics.air.gravity == 9.8
    assert scenario.scales == (4,) and scenario.name == "mine"


def test_all_kinds_and_scales_are_played_equally_often():
    scenario = Scenario(scale=(3, 5))
    shots = [scenario.shot(seed) for seed in range(16)]
    assert {shot: shots.count(shot) for shot in shots} == {(kind, scale): 2 for kind in SHOT_KINDS for scale in (3, 5)}


def test_a_scenario_may_be_played_by_another_arm(tmp_path):
    (tmp_path / "arm.urdf").write_text(EIGHT)
    (tmp_path / "eight.yaml").write_text("urdf: arm.urdf\ntip: flange\nbase: [-0.6, 0.76, -0.1, 0.0]\nmount: [0.15, 1.5708]\n")
    (tmp_path / "with_eight.yaml").write_text("arm: eight.yaml\nimages: false\n")
    scenario = load(str(tmp_path / "with_eight.yaml"))
    assert Path(scenario.arm) == tmp_path / "eight.yaml"
    episode = play(scenario, 0)
    assert episode.joints.shape[1] == 1 + 2 * 8
    assert load("liu").arm == "pa10"
