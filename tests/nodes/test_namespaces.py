"""Two robots play in two namespaces of one domain at the same time."""

import subprocess
import sys
from signal import SIGINT

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger
from tt_core.ros.diagnostics import Event, read_status
from tt_core.ros.qos import RELIABLE

ROBOTS = ("red", "blue")


@pytest.fixture
def robots(ros, tmp_path):
    """Both whole robots, each started by the launch file with its namespace."""
    launch = [sys.executable, "-m", "tt_tools.ros2", "launch", "tt_bringup", "sim.launch.yaml"]
    # at a fifth of real time two robots keep their deadlines on two cores
    arguments = ("use_sim_time:=true", "rtf:=0.2", "markers:=false")
    logs = [(tmp_path / f"{name}.txt").open("w") for name in ROBOTS]
    running = [
        subprocess.Popen([*launch, f"namespace:={name}", *arguments], stdout=log, stderr=subprocess.STDOUT)
        for name, log in zip(ROBOTS, logs, strict=True)
    ]
    yield
    for process in running:
        process.send_signal(SIGINT)
    codes = [process.wait(timeout=120) for process in running]
    assert codes == [0, 0], [(tmp_path / f"{name}.txt").read_text()[-2000:] for name in ROBOTS]


def test_two_robots_play_at_the_same_time(robots, probe, until):
    results = {f"{name}/sim": list[str]() for name in ROBOTS}

    def on_status(message):
        for status in read_status(message):
            if status.event is Event.BALL_OVER:
                results[status.name].append(status.values["result"])

    def launch_until_returned():
        """Launch a ball for each robot that has not returned one: on a busy machine a ball may be missed."""
        for name, launcher in launchers.items():
            if "returned" not in results[f"{name}/sim"]:
                launcher.call_async(Trigger.Request())  # refused while a ball flies

    probe.create_subscription(DiagnosticArray, "/diagnostics", on_status, RELIABLE)
    launchers = {name: probe.create_client(Trigger, f"/{name}/launcher/launch") for name in ROBOTS}
    topics = [f"/{name}/{topic}" for name in ROBOTS for topic in ("racket/strokes", "ball/path", "arm_velocity_controller/commands")]
    until(lambda: all(map(probe.count_publishers, topics)) and all(map(probe.count_subscribers, topics)), probe, 240.0)
    until(lambda: all(client.service_is_ready() for client in launchers.values()), probe)
    probe.create_timer(1.0, launch_until_returned)
    until(lambda: all("returned" in each for each in results.values()), probe, 240.0)
    assert not {name for name, _ in probe.get_topic_names_and_types() if name.startswith(("/camera", "/ball", "/clock"))}
