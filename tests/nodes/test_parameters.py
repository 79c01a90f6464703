"""The parameter file holds every parameter, nodes describe theirs, and what cannot act at run time cannot be set."""

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import check_named
from tt_bringup.parameters import OF_MIDDLEWARE, as_markdown, as_yaml, collect
from tt_core.errors import TtError
from tt_tools import packages
from tt_tools.parameter_client import ParameterClient

CONFIG = packages.share("tt_bringup") / "config" / "parameters.yaml"
REFERENCE = Path(__file__).parents[2] / "docs" / "parameters.md"


def ros2(*words):
    """What the small ros2 prints."""
    done = subprocess.run([sys.executable, "-m", "tt_tools.ros2", *words], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def ports():
    """The files in shared memory at which participants of this process receive."""
    return set(re.findall(r"fastrtps_port\d+", Path("/proc/self/maps").read_text()))


@pytest.fixture(scope="module")
def declared():
    """All parameters as the nodes tell them, by node. The nodes are gone afterwards, also for other processes in their domain."""
    before = ports()
    found = collect()
    assert ports() <= before
    return found


def test_file_and_reference_hold_every_parameter_of_every_node(declared):
    """After a change: python -m tt_bringup.parameters ros_ws/src/tt_bringup/config/parameters.yaml docs/parameters.md."""
    assert CONFIG.read_text() == as_yaml(declared)
    assert REFERENCE.read_text() == as_markdown(declared)


def test_every_parameter_tells_its_meaning_and_its_bounds(declared):
    for node, parameters in declared.items():
        for one in parameters:
            numeric = isinstance(one.value, (int, float)) and not isinstance(one.value, bool)
            bounded = one.descriptor.integer_range or one.descriptor.floating_point_range or one.descriptor.additional_constraints
            assert one.descriptor.description and (bounded or not numeric), f"{node}: {one.name}"


def test_what_acts_at_run_time_can_be_set_and_the_rest_cannot(start, probe, until):
    start("tt_racket.racket_node")
    client = ParameterClient(probe, "racket", 120.0)
    from rclpy.parameter import Parameter

    client.set([Parameter("goal.flight_time", value=0.5)])
    assert client.values(["goal.flight_time"])[0].double_value == 0.5
    with pytest.raises(TtError):
        client.set([Parameter("goal.flight_time", value=99.0)])  # out of range
    with pytest.raises(TtError):
        client.set([Parameter("x_low", value=-0.3)])  # read at the start only
    assert "Read only: true" in ros2("param", "describe", "/racket", "x_low")
    assert "Max value: 2.0" in ros2("param", "describe", "/racket", "goal.flight_time")


def test_a_dumped_file_starts_the_node_again(start, probe, until, tmp_path):
    first = start("tt_arm.arm_node", "--ros-args", "-p", "swing.acceleration:=15.0", "-p", "guard.margin:=0.02", "-p", "rtf:=1")
    client = ParameterClient(probe, "arm", 120.0)
    assert client.values(["rtf"])[0].double_value == 1.0  # a whole number was given
    (tmp_path / "arm.yaml").write_text(ros2("param", "dump", "/arm"))
    before = dict(zip(client.names(), client.values(client.names()), strict=True))
    first.terminate()
    first.wait(timeout=120)
    until(lambda: not probe.count_publishers("/arm_velocity_controller/commands"), probe)
    start("tt_arm.arm_node", "--ros-args", "--params-file", str(tmp_path / "arm.yaml"))
    again = ParameterClient(probe, "arm", 120.0)
    names = [name for name in again.names() if not name.startswith(OF_MIDDLEWARE)]
    assert dict(zip(names, again.values(names), strict=True)) == {name: before[name] for name in names}
    assert before["swing.acceleration"].double_value == 15.0


def test_a_world_excludes_coefficients_beside_it(start):
    node = start("tt_sim.sim_node", "--ros-args", "-p", "world:=real", "-p", "plant.speed_share:=0.5")
    assert node.wait(timeout=120) == 2
    check_named(node.stderr.read(), "world", "real", "plant.*")


def test_nan_stands_for_the_value_of_the_model(start, probe):
    start("tt_predict.predict_node", "--ros-args", "-p", "physics:=measured", "-p", "air.drag:=.nan")
    (drag,) = ParameterClient(probe, "predict", 120.0).values(["air.drag"])
    assert math.isfinite(drag.double_value) and drag.double_value != 0.505
