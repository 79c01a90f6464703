"""The command line on a running graph."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import PointStamped
from std_srvs.srv import SetBool
from trajectory_msgs.msg import MultiDOFJointTrajectory

LAUNCH = """
launch:
  - arg: {name: output}
  - node:
      pkg: tt_tools
      exec: record_node
      name: witness
      namespace: court
      param:
        - {name: output, value: $(var output), type: str}
"""


@pytest.fixture
def ros2(ros):
    """ros2(*words) starts the command; its output is read by communicate()."""
    started = []

    def ros2(*words):
        command = [sys.executable, "-m", "tt_tools.ros2", *words]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ))
        return started[-1]

    yield ros2
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def printed(ros2, probe, until):
    """told(*words) runs the command to its end while the probe answers; returns exit code, output and errors."""

    def printed(*words):
        process = ros2(*words)
        until(lambda: process.poll() is not None, probe)
        output = process.communicate()[0]
        return process.returncode, output

    return printed


@pytest.fixture
def points(probe):
    """The probe publishes a stamped point on /point, 100 times a second."""
    output = probe.create_publisher(PointStamped, "/point", 10)

    def publish():
        message = PointStamped()
        message.header.stamp, message.point.x = probe.get_clock().now().to_msg(), 1.5
        output.publish(message)

    probe.create_timer(0.01, publish)
    return output


def test_it_tells_of_the_graph(printed, points):
    assert "/probe" in printed("node", "list")[1].splitlines()
    assert "/point [geometry_msgs/msg/PointStamped]" in printed("topic", "list", "-t")[1].splitlines()
    assert printed("topic", "type", "/point") == (0, "geometry_msgs/msg/PointStamped\n")
    assert printed("topic", "find", "geometry_msgs/PointStamped") == (0, "/point\n")
    end, names_unknown = time.monotonic() + 60.0, True
    while names_unknown and time.monotonic() < end:  # on a busy machine names come later than the 2 s that a command waits for them
        code, text = printed("topic", "info", "-v", "/point")
        names_unknown = "_NODE_NAME_UNKNOWN_" in text
    assert code == 0 and text.startswith("Type: geometry_msgs/msg/PointStamped\n\nPublisher count: 1\n\nNode name: probe\n")
    assert "    /point: geometry_msgs/msg/PointStamped\n" in printed("node", "info", "/probe")[1]
    assert "/probe/set_parameters [rcl_interfaces/srv/SetParameters]" in printed("service", "list", "-t")[1].splitlines()
    assert "  use_sim_time (type: boolean)" in printed("param", "list", "/probe", "--param-type")[1].splitlines()


def test_what_is_not_there_is_an_error(ros2, probe, until):
    verbs = ("topic info /nothing", "topic echo /nothing", "topic type /nothing", "node info /nobody", "param get /nobody use_sim_time")
    processes = {words: ros2(*words.split()) for words in verbs}  # at the same time: each looks for a while
    for words, process in processes.items():
        until(lambda process=process: process.poll() is not None, probe)
        assert process.returncode == 1, words
    assert processes["topic type /nothing"].communicate()[0] == ""


def test_it_prints_messages(printed, points):
    whole = yaml.safe_load(printed("topic", "echo", "/point", "--once")[1].removesuffix("---\n"))
    assert whole["header"].keys() == {"stamp", "frame_id"} and whole["point"] == {"x": 1.5, "y": 0.0, "z": 0.0}
    assert printed("topic", "echo", "/point", "--once", "--field", "point") == (0, "x: 1.5\ny: 0.0\nz: 0.0\n---\n")
    assert printed("topic", "echo", "/point", "--once", "--field", "point.x") == (0, "1.5\n---\n")
    assert printed("topic", "echo", "/point", "--once", "--csv", "--field", "point", "--qos-reliability", "best_effort") == (
        0,
        "1.5,0.0,0.0\n",
    )
    assert printed("topic", "echo", "/point", "--once", "--field", "pint")[0] == 1


@pytest.mark.parametrize(
    ("verb", "number"), [("hz", r"average rate: ([\d.]+)\n"), ("bw", r"([\d.]+) (?:K?B)/s from"), ("delay", r"average delay: ([\d.]+)\n")]
)
def test_it_measures_a_topic_until_it_is_interrupted(ros2, probe, until, points, verb, number):
    process = ros2("topic", verb, "/point", "-w", "50")
    os.set_blocking(process.stdout.fileno(), False)
    lines = []
    until(lambda: lines.extend(process.stdout.readlines()) or re.search(number, "".join(lines)), probe)
    found = float(re.search(number, "".join(lines))[1])
    if verb == "hz":
        assert found == pytest.approx(100.0, rel=0.5)  # of a busy machine
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=120) == 0


def test_it_publishes(printed, probe):
    got = []
    probe.create_subscription(MultiDOFJointTrajectory, "/goal", got.append, 10)
    values = "{header: auto, joint_names: [ball], points: [{transforms: [{translation: {x: 2}}], time_from_start: {sec: 1}}]}"
    code, text = printed("topic", "pub", "-t", "2", "-r", "20", "/goal", "trajectory_msgs/msg/MultiDOFJointTrajectory", values)
    assert code == 0 and "publishing #2: trajectory_msgs.msg.MultiDOFJointTrajectory(" in text
    assert len(got) == 2 and got[0].header.stamp.sec > 0 and got[0].joint_names == ["ball"]
    assert got[0].points[0].transforms[0].translation.x == 2.0 and got[0].points[0].time_from_start.sec == 1


def test_it_calls_services(printed, probe):
    asked = []

    def serve(request, response):
        asked.append(request.data)
        response.message = "done"
        return response

    probe.create_service(SetBool, "/arm/enable", serve)
    code, text = printed("service", "call", "/arm/enable", "std_srvs/srv/SetBool", "{data: true}")
    assert code == 0 and "response:\nstd_srvs.srv.SetBool_Response(success=False, message='done')\n" in text
    assert asked == [True]
    for kind, values in (("std_srvs/srv/SetBool", "{date: true}"), ("std_srvs/srv/Trigger", "{}"), ("std_srvs/msg/No", "{}")):
        assert printed("service", "call", "/arm/enable", kind, values)[0] == 1
    nested = "{parameters: [{name: speed, value: {type: 3, double_value: 0.5}}]}"
    probe.declare_parameter("speed", 1.0)
    assert printed("service", "call", "/probe/set_parameters", "rcl_interfaces/srv/SetParameters", nested)[0] == 0
    assert probe.get_parameter("speed").value == 0.5


def test_launch_starts_named_nodes_and_leaves_none(ros2, probe, until, tmp_path):
    file, bag = tmp_path / "test.launch.yaml", tmp_path / "bag"
    file.write_text(LAUNCH)
    system = ros2("launch", str(file), f"output:={bag}")
    until(lambda: any(info.node_namespace == "/court" for info in probe.get_subscriptions_info_by_topic("/rosout")), probe)
    system.send_signal(signal.SIGINT)
    printed = system.communicate(timeout=120)[0]
    assert system.returncode == 0, printed
    assert f"[witness] recording to {bag}" in printed
    assert (bag / "metadata.yaml").is_file()
    assert not running(bag)


def test_a_killed_launch_leaves_no_node(ros2, probe, until, tmp_path):
    file, bag = tmp_path / "test.launch.yaml", tmp_path / "bag"
    file.write_text(LAUNCH)
    system = ros2("launch", str(file), f"output:={bag}")
    until(lambda: (bag / "bag.mcap").is_file(), probe)
    assert running(bag)
    system.kill()
    until(lambda: not running(bag), probe)


def running(bag):
    """The processes that name `bag`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has just ended
            found += [path] * (str(bag) in path.read_text())
    return found


def test_run_becomes_the_executable(ros2, tmp_path):
    process = ros2("run", "tt_tools", "record_node", "--ros-args", "-p", f"output:={tmp_path}")
    assert "exists already" in process.communicate(timeout=120)[0]
    assert process.returncode == 2


def test_it_sets_parameters(ros2, probe, until):
    probe.declare_parameter("speed", 1.0)
    done = ros2("param", "set", "/probe", "speed", "0.2")
    until(lambda: done.poll() is not None, probe)
    assert done.communicate()[0] == "Set parameter successful\n" and done.returncode == 0
    assert probe.get_parameter("speed").value == 0.2
    refused = ros2("param", "set", "/probe", "speed", "fast")  # no number
    until(lambda: refused.poll() is not None, probe)
    assert refused.returncode == 1 and "speed" in refused.communicate()[0]
