"""The command line on a running graph."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from geometry_msgs.msg import Point
from std_srvs.srv import SetBool

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


def test_it_tells_of_nodes_and_topics(ros2, probe, until):
    output = probe.create_publisher(Point, "/point", 10)
    probe.create_timer(0.01, lambda: output.publish(Point(x=1.5)))
    nodes, topics, message = ros2("node", "list"), ros2("topic", "list", "-t"), ros2("topic", "echo", "/point", "--once")
    rate = ros2("topic", "hz", "/point", "-w", "50")
    until(lambda: all(process.poll() is not None for process in (nodes, topics, message)), probe)
    assert "/probe" in nodes.communicate()[0].splitlines()
    assert "/point [geometry_msgs/msg/Point]" in topics.communicate()[0].splitlines()
    assert message.communicate()[0] == "{x: 1.5, y: 0.0, z: 0.0}\n---\n"
    until(lambda: output.get_subscription_count() == 1, probe)
    os.set_blocking(rate.stdout.fileno(), False)
    lines = []
    until(lambda: lines.extend(rate.stdout.readlines()) or any("average rate" in line for line in lines), probe)
    assert float(next(line for line in lines if "average" in line).split()[-1]) == pytest.approx(100.0, rel=0.3)  # of a busy machine
    rate.send_signal(signal.SIGINT)
    assert rate.wait(timeout=20) == 0


def test_it_calls_services(ros2, probe, until):
    asked = []

    def serve(request, response):
        asked.append(request.data)
        response.message = "done"
        return response

    probe.create_service(SetBool, "/arm/enable", serve)
    good, bad = (ros2("service", "call", "/arm/enable", "std_srvs/srv/SetBool", f"{{{field}: true}}") for field in ("data", "date"))
    until(lambda: good.poll() is not None and bad.poll() is not None, probe)
    assert good.communicate()[0] == "success: false\nmessage: done\n"
    assert asked == [True]
    assert bad.returncode == 1 and "whose fields are {'data': 'boolean'}" in bad.communicate()[0]


def test_launch_starts_named_nodes_and_leaves_none(ros2, probe, until, tmp_path):
    file, bag = tmp_path / "test.launch.yaml", tmp_path / "bag"
    file.write_text(LAUNCH)
    system = ros2("launch", str(file), f"output:={bag}")
    until(lambda: any(info.node_namespace == "/court" for info in probe.get_subscriptions_info_by_topic("/rosout")), probe)
    system.send_signal(signal.SIGINT)
    told = system.communicate(timeout=20)[0]
    assert system.returncode == 0, told
    assert f"[witness] recording to {bag}" in told
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
    assert "exists already" in process.communicate(timeout=20)[0]
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
