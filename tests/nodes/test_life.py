"""The life of nodes: an interrupt at any moment, what they wait for, and what happens when one is killed."""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from refusals import check_named
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.priority import RESPONSE
from tt_core.ros import diagnostics as status_module
from tt_core.ros.diagnostics import Status
from tt_core.ros.inputs import STATE_FORM, Input
from tt_core.ros.presence import Presence
from tt_core.ros.qos import LATEST, RELIABLE
from tt_core.shared_memory import IMAGE_SEGMENT, SMALL_SEGMENT
from tt_tools import packages

BAG = Path(__file__).parents[2] / "bags" / "reference_back_5"
NODES = {
    "sim_node": ("tt_sim", ()),
    "camera_node": ("tt_vision", ("--ros-args", "-p", "kind:=bag", "-p", f"path:={BAG}")),
    "estimate_node": ("tt_vision", ()),
    "track_node": ("tt_vision", ()),
    "predict_node": ("tt_predict", ()),
    "racket_node": ("tt_racket", ()),
    "arm_node": ("tt_arm", ()),
    "record_node": ("tt_tools", ("--ros-args", "-p", "output:=bag")),
    "play_node": ("tt_tools", ("--ros-args", "-p", f"bag:={BAG}", "-p", "wait_for:=[/nothing]")),
}


@pytest.fixture
def execute(ros, tmp_path):
    """execute(name, *arguments) starts the executable of a node; what it prints on stderr is in its folder."""
    running = []

    def execute(name, *arguments):
        package, usual = NODES[name]
        (folder := tmp_path / name).mkdir()
        with (folder / "stderr").open("w") as file:
            command = [packages.executable(package, name), *(arguments or usual)]
            running.append(subprocess.Popen(command, cwd=folder, stderr=file, stdout=subprocess.DEVNULL))
        return running[-1], folder / "stderr"

    yield execute
    for process in running:
        process.kill()
        process.wait()


def is_made(process):
    """Whether a node has taken over SIGTERM, as it does when it is made."""
    caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process.pid}/status").read_text())
    return bool(int(caught[1], 16) >> (signal.SIGTERM - 1) & 1)


def check_end(process, number, printed):
    code = process.wait(timeout=10.0)
    assert code in (0, -number), f"{process.args} by {number.name}: exit code {code}: {printed.read_text()}"
    assert "Traceback" not in printed.read_text(), printed.read_text()
    return code


@pytest.mark.parametrize("seed", range(2))
def test_an_interrupt_ends_a_node_while_it_starts(execute, seed):
    """At moments from the start of Python on; `scripts/bench starts` has more of it, with times."""
    rng = random.Random(seed)
    running = [execute(name) for name in rng.sample(list(NODES), 4)]
    start = time.monotonic()
    for moment, (process, printed) in zip(sorted(rng.uniform(0.0, 2.0) for _ in running), running, strict=True):
        time.sleep(max(0.0, start + moment - time.monotonic()))
        number = rng.choice((signal.SIGINT, signal.SIGTERM))
        process.send_signal(number)
        check_end(process, number, printed)


def test_an_interrupt_ends_a_node_that_spins(execute):
    """Closed, with exit code 0."""
    rng = random.Random(0)
    running = [execute(name) for name in NODES]
    for process, printed in running:
        end = time.monotonic() + 120.0
        while not is_made(process):
            assert time.monotonic() < end and process.poll() is None, printed.read_text()
            time.sleep(0.05)
        number = rng.choice((signal.SIGINT, signal.SIGTERM))
        process.send_signal(number)
        assert check_end(process, number, printed) == 0


@pytest.mark.parametrize("words", [["-p", "foo"], ["--params-file", "/no/such.yaml"], ["-r", "a:b"], ["-p", "until_x:=far"]])
def test_malformed_arguments_are_told_without_a_traceback(execute, words):
    process, printed = execute("predict_node", "--ros-args", *words)
    assert process.wait(timeout=120) == 2
    lines = printed.read_text().splitlines()
    assert 1 <= len(lines) <= 2 and "Traceback" not in lines[0]  # rcl may tell before us that there is something


def test_a_node_tells_how_it_is_called(execute):
    for name in NODES:
        process, printed = execute(name, "--help")
        assert process.wait(timeout=120) == 0 and not printed.read_text()


def test_a_second_signal_waits_until_the_node_has_closed(start, tmp_path, probe, until):
    """A recorder that is interrupted twice has a complete bag."""
    recorder = start("tt_tools.record_node", "--ros-args", "-p", f"output:={tmp_path / 'bag'}")
    until(lambda: probe.count_subscribers("/rosout") > 0, probe)
    for number in (signal.SIGINT, signal.SIGTERM):
        recorder.send_signal(number)
    # minus the number of the signal if DDS hangs at the end: the kernel then ends the process after 2 s, see `end_by_signal`
    assert recorder.wait(timeout=10.0) in (0, -signal.SIGINT, -signal.SIGTERM)
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_it_tells_what_it_waits_for(probe, until, monkeypatch):
    statuses = []

    def refuse(error: TtError) -> None:
        raise error

    monkeypatch.setattr(status_module, "START_GRACE", 2.5)
    monkeypatch.setattr(status_module, "STATUS_PERIOD", 0.2)
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda message: statuses.extend(message.status), RELIABLE)
    ball = Input(probe, STATE_FORM, "ball/state", lambda _: None, RELIABLE, refused=refuse)
    Status(probe).wait_for([ball])

    def last():
        return [(s.name, s.level, {v.key: v.value for v in s.values}) for s in statuses[-1:]]

    until(lambda: last() == [("probe: inputs", DiagnosticStatus.OK, {"/ball/state": "0"})], probe)
    until(lambda: last() == [("probe: inputs", DiagnosticStatus.WARN, {"/ball/state": "0"})], probe)
    publisher = probe.create_publisher(Odometry, "/ball/state", RELIABLE)
    until(lambda: last() == [("probe: inputs", DiagnosticStatus.OK, {"/ball/state": "1"})], probe)
    probe.destroy_publisher(publisher)
    until(lambda: last() == [("probe: inputs", DiagnosticStatus.WARN, {"/ball/state": "0"})], probe)


@pytest.mark.parametrize("willing", [True, False])
def test_enable_calls_the_service_once_when_it_is_there(start, probe, until, willing):
    asked = []

    def serve(request, response):
        asked.append(request.data)
        response.success, response.message = willing, "so be it"
        return response

    program = start("tt_arm.enable_node")
    until(lambda: "enable" in probe.get_node_names(), probe)  # it waits
    probe.create_service(SetBool, "/arm/enable", serve)
    until(lambda: asked and program.poll() is not None, probe)
    assert asked == [True] and program.returncode == (0 if willing else 1)


@pytest.fixture
def robot(ros, tmp_path):
    """The robot of sim.launch.yaml, as `ros2 launch` starts it; `robot()` is what it has printed."""
    given = ("use_sim_time:=true", "rtf:=0.5")  # what happens is tested, not how fast a machine with other work is
    printed = tmp_path / "robot.txt"
    with printed.open("w") as file:
        command = [sys.executable, "-m", "tt_tools.ros2", "launch", "tt_bringup", "sim.launch.yaml", *given]
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    yield printed.read_text
    process.send_signal(signal.SIGINT)
    try:
        assert process.wait(timeout=120) == 0, printed.read_text()
    finally:
        process.kill()


def started(printed, name):
    """The process ids of a node, in the order of its starts."""
    return [int(pid) for pid in re.findall(rf"^\[launch\] {name} started, process (\d+)$", printed, re.MULTILINE)]


def test_play_resumes_after_crashes(robot, probe, until):
    """The next ball is measured, predicted and answered with strokes; the arm moves only when a person has enabled it again."""
    Presence(probe)  # a kill may block other nodes for longer than the DDS lease; like them, the probe announces itself afterwards
    paths, strokes, commands = [], [], []
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", paths.append, RELIABLE)
    probe.create_subscription(MultiDOFJointTrajectory, "/racket/strokes", strokes.append, LATEST)
    probe.create_subscription(Float64MultiArray, "/arm_velocity_controller/commands", lambda m: commands.append(np.array(m.data)), LATEST)
    launcher = probe.create_client(Trigger, "/launcher/launch")
    until(launcher.service_is_ready, probe)

    def play(seen):
        """Ask for a ball every second, of which one flies at a time, until `seen()`."""
        timer = probe.create_timer(1.0, lambda: launcher.call_async(Trigger.Request()))
        until(seen, probe)
        probe.destroy_timer(timer)

    def moves():
        return any(command.any() for command in commands)

    play(lambda: paths and strokes and moves())
    until(lambda: "[enable] /arm/enable: enabled" in robot(), probe)  # printed after the arm was enabled

    killed = {name: started(robot(), name)[-1] for name in ("predict", "racket", "arm")}
    for pid in killed.values():
        os.kill(pid, signal.SIGKILL)
    until(lambda: all(started(robot(), name)[-1] != pid for name, pid in killed.items()), probe)
    for seen in (paths, strokes, commands):
        seen.clear()
    play(lambda: paths and strokes and commands)
    assert not moves()
    assert len(started(robot(), "enable")) == 1

    enabler = probe.create_client(SetBool, "/arm/enable")
    until(enabler.service_is_ready, probe)
    answer = enabler.call_async(SetBool.Request(data=True))
    until(answer.done, probe)
    assert answer.result().success
    play(moves)


def test_a_crash_in_a_thread_ends_the_node(ros, monkeypatch):
    """As one in a callback does: it would not be started again otherwise."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    command = [sys.executable, "-m", "tt_core.start", "crashing_thread"]
    node = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert node.returncode == 1 and node.stdout == "closed\n", node
    assert "Traceback" not in node.stderr
    check_named(node.stderr.splitlines()[-1], "RuntimeError", "crashing_thread.py")


def test_a_node_that_ends_its_context_itself_ends_well(start, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    node = start("ending_itself")
    assert node.wait(timeout=120) == 0
    assert "Exception" not in node.stderr.read()


def test_a_node_that_hangs_while_it_is_destroyed_ends_by_the_signal(start, probe, until, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    node = start("hanging_end")
    until(lambda: "hanging_end" in probe.get_node_names(), probe)
    node.send_signal(signal.SIGTERM)
    assert node.wait(timeout=120) == -signal.SIGTERM


def test_a_node_that_is_never_made_ends_and_tells_where_it_hung(start, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    node = start("hanging_make")
    assert node.wait(timeout=120) == 1
    assert "hanging_make.py" in node.stderr.read()


def test_a_node_that_hangs_after_it_refused_its_parameters_ends_by_the_signal(start, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    node = start("hanging_start")
    assert node.wait(timeout=120) == -signal.SIGTERM
    check_named(node.stderr.read(), "some_parameter", 3, 0, 2)


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("setpriv") is None, reason="takes root and setpriv to give up the permission")
def test_a_node_without_permission_for_its_priority_says_so_and_runs(ros, probe, until, tmp_path):
    printed = tmp_path / "printed.txt"
    command = ["setpriv", "--bounding-set=-sys_nice", sys.executable, "-m", "tt_core.start", "tt_predict.predict_node"]
    with printed.open("w") as file, subprocess.Popen(command, stderr=file) as node:
        until(lambda: "predict" in probe.get_node_names(), probe)
        until(lambda: f"priority {RESPONSE.realtime}" in printed.read_text(), probe)
        until(lambda: "ready" in printed.read_text(), probe)
        node.send_signal(signal.SIGTERM)
        assert node.wait(timeout=120) in (0, -signal.SIGTERM)


def segments(pid):
    """Return the sizes (bytes) of all Fast DDS shared memory segments that a process has mapped: its own and those of other processes."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    mapped = [line.split()[0].split("-") for line in lines if re.search(r"/fastrtps_[0-9a-f]{16}$", line)]
    return [int(end, 16) - int(begin, 16) for begin, end in mapped]


@pytest.mark.parametrize("name", ["sim_node", "camera_node", "play_node", "predict_node"])
def test_a_node_that_sends_images_has_room_for_those_that_a_dead_receiver_leaves(start, probe, until, name):
    package, options = NODES[name]
    node = start(f"{package}.{name}", *options)
    size = SMALL_SEGMENT if name == "predict_node" else IMAGE_SEGMENT
    until(lambda: any(size <= found < 1.1 * size for found in segments(node.pid)), probe)  # the middleware adds 5 % for its own notes
