"""Scenarios are read strictly: what is there can be played, what is wrong is told by its path in the file."""

from dataclasses import fields

import pytest
import yaml
from tt_core.physics import Physics
from tt_core.strict_yaml import BadFile, names
from tt_eval.scenario import HOME, Scenario, load
from tt_sim.cameras.camera_faults import CameraFaults
from tt_sim.cameras.tracking_cameras import TrackingCameraFaults
from tt_sim.domain_randomization import DomainRandomization
from tt_sim.world.launcher import KINDS
from tt_sim.world.plant import PlantParams
from tt_sim.world_file import WORLDS

PROFILES = {"ideal", "liu", "real", "harsh"}


def test_every_scenario_world_and_robot_here_can_be_read():
    assert set(names(HOME / "scenarios")) >= PROFILES
    assert {load("liu", robot=robot).robot.stroke for robot in names(HOME / "robots")} == {"exact", "sam", "specular"}
    for scenario in [load(name) for name in names(HOME / "scenarios")]:
        assert isinstance(scenario, Scenario)
    for world in names(WORLDS):
        load("liu", world=world)


def test_every_profile_names_every_fault():
    """Zero where it has none, so that a reader sees what there is; `real` and `harsh` have them all."""
    kinds = {
        "domain_randomization": DomainRandomization,
        "cameras": CameraFaults,
        "tracking_cameras": TrackingCameraFaults,
        "plant": PlantParams,
    }
    for name in PROFILES:
        content = yaml.safe_load((WORLDS / f"{name}.yaml").read_text())
        for part, kind in kinds.items():
            assert set(content[part]) == {field.name for field in fields(kind)}, (name, part)
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


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ({"launcher": {"rate": -3}}, "mine.yaml: launcher.rate: -3 is outside [26, 94]"),
        ({"launcher": {"rte": 30}}, "mine.yaml: launcher.rte: unknown, known are x, y"),
        ({"robot": {"latency": "soon"}}, "mine.yaml: robot.latency: 'soon' is not of type float"),
        ({"robot": {"intercept": {"spacing": 0}}}, "mine.yaml: robot.intercept.spacing: 0 is outside"),
        ({"world": {"physics": {"model": "measured", "air": {"drag": 9.0}}}}, "mine.yaml: world.physics.air.drag: 9 is outside [0, 2]"),
        ({"world": {"physics": "newton"}}, "mine.yaml: world.physics.model: 'newton' is none of liu, measured"),
        ({"world": {"physics": {"contact_height": 0.0}}}, "mine.yaml: world.contact_height: 0 is outside"),
        ({"world": {"cameras": {"dropped": 1.5}}}, "mine.yaml: world.cameras.dropped: 1.5 is outside [0, 1]"),
        ({"world": {"domain_randomization": {"drag": -0.1}}}, "mine.yaml: world.domain_randomization.drag: -0.1 is outside"),
        ({"world": {"plant": {"time_constant": float("nan")}}}, "mine.yaml: world.plant: time_constant = nan is not finite"),
        ({"world": {"plant": {"q_step": True}}}, "mine.yaml: world.plant.q_step: True is not of type float"),
        ({"scale": [3, 11]}, "mine.yaml: scale: 11 is outside [1, 10]"),
        ({"kind": "lob"}, "mine.yaml: kind 'lob' is none of top, back"),
        ({"shots": "given"}, "mine.yaml: ball is missing"),
        (
            {"shots": "given", "images": False, "ball": {"position": [2.6, 0.7, 0.3], "velocity": [-17, 0, 0], "spin": [0, 0, 0]}},
            "mine.yaml: speed of the ball without images: 17 is outside [0, 16]",
        ),
        ({"session": 20}, "mine.yaml: session = 20 goes with a launcher.rate"),
        ({"session": 1, "launcher": {"rate": 60}}, "mine.yaml: session: 1 is outside [2, 1000]"),
        ({"shots": "rotation", "launcher": {"rate": 60}}, "mine.yaml: launcher.rate = 60 goes with balls that fly"),
        ({"world": {"tracking_cameras": {"noise": -0.1}}}, "mine.yaml: world.tracking_cameras.noise: -0.1 is outside [0, 10]"),
        ({"goal": {"landing": [2.0], "flight_time": 0.5, "spin_y": 0, "spin_z": 0}}, "mine.yaml: goal: landing has shape"),
        ({"goal": {"landing": [2.0, 0.7]}}, "mine.yaml: goal: "),
        ({"world": "mars"}, "mars: no such file, and none of the worlds here, harsh, ideal, liu, real"),
        ("a word", "mine.yaml: 'a word' is not a mapping"),
    ],
)
def test_what_is_wrong_is_told_by_its_path(content, told, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(BadFile) as error:
        load(str(file))
    assert str(error.value).startswith(told)


def test_a_file_that_is_no_yaml_is_refused(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("launcher:\n  rate: 30\n  rate: 60\n")
    with pytest.raises(BadFile, match=r"^mine\.yaml: rate is given twice"):
        load(str(file))
    file.write_text("a: [1, 2")
    with pytest.raises(BadFile, match=r"^mine\.yaml: "):
        load(str(file))
    with pytest.raises(BadFile, match="no such file"):
        load(str(tmp_path / "other.yaml"))


def test_a_scenario_names_files_beside_it(tmp_path):
    (tmp_path / "moon.yaml").write_text("physics: {model: liu, air: {gravity: 1.6}}")
    (tmp_path / "mine.yaml").write_text("world: moon.yaml\nscale: 4")
    scenario = load(str(tmp_path / "mine.yaml"))
    assert scenario.world.physics.air.gravity == 1.6 and scenario.robot.physics.air.gravity == 9.8
    assert scenario.scales == (4,) and scenario.name == "mine"


def test_all_kinds_and_scales_are_played_equally_often():
    scenario = Scenario(scale=(3, 5))
    shots = [scenario.shot(seed) for seed in range(16)]
    assert {shot: shots.count(shot) for shot in shots} == {(kind, scale): 2 for kind in KINDS for scale in (3, 5)}
