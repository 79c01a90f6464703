"""Real ROS for node tests: a domain of its own, on this machine only, every process ended."""

import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The same examples in each run: a test fails because of a change, not by chance. With TT_FUZZ=N they are new ones, and N times as many.
# No deadlines: the first call of a kernel may compile it, and a busy machine is slow.
FUZZ = int(os.environ.get("TT_FUZZ", "0"))
settings.register_profile(
    "tests", deadline=None, derandomize=not FUZZ, max_examples=100 * max(FUZZ, 1), suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("tests")

LEASE = 2.0  # s without a message after which DDS forgets a participant; leaseDuration in config/fastdds.xml
ENDING = 10.0  # s for a node to end; the launcher waits as long before it kills
SENT = (-signal.SIGINT, -signal.SIGTERM, -signal.SIGKILL)  # exit codes by signals that tests send

WHOLE_ROBOTS = {"test_life.py", "test_namespaces.py", "test_rally.py", "test_ros_tools.py", "test_two_hosts.py", "test_view_node.py"}


def pytest_xdist_make_scheduler(config, log):
    """Let one process run the tests of a file, and one process all whole robots, so that they play one after the other."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "whole robots" if Path(file).name in WHOLE_ROBOTS else file

    return Scheduling(config, log)


def pytest_configure():
    gc.disable()  # while tests are collected: modules and tests are never garbage, but searching them takes a third of the time


def pytest_collection_finish():
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items):
    """Begin with the whole robots, which take longest."""
    items.sort(key=lambda item: item.path.name not in WHOLE_ROBOTS)


@pytest.fixture
def ros(tmp_path, monkeypatch):
    """The number of a free domain; this process and its children are on it."""
    from domain_coordinator import domain_id
    from domains import next_domain
    from tt_core.shared_memory import remove_leftovers

    remove_leftovers()  # files in shared memory of nodes that earlier tests killed
    with domain_id(next_domain) as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        yield domain


@pytest.fixture
def start(ros, tmp_path):
    """start("package.module", *args) runs a node in a process of its own, as its executable does; `stderr` is what it has printed so far.

    After the test it is interrupted and must end in order, at whatever moment that is.
    """
    processes = []

    def start(module, *args):
        command = ["env", "--block-signal=INT", sys.executable, "-m", "tt_core.start", module, *args]
        log = tmp_path / f"stderr_{len(processes)}.txt"  # a pipe that nobody reads would stop a node that prints much
        with log.open("w") as file:
            process = subprocess.Popen(command, stderr=file)
        process.stderr = log.open()
        processes.append(process)
        return process

    yield start
    running = [process for process in processes if process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGINT)
    wrong = [process for process in running if not _ends(process)]
    # before that it may have ended by itself or by a signal of the test, but not by a crash
    wrong += [process for process in processes if process.returncode < 0 and process.returncode not in SENT]
    for process in processes:
        with process.stderr:
            process.stderr.seek(0)
            printed = process.stderr.read()
        if process in wrong or "Traceback" in printed:
            pytest.fail(f"{process.args} ended with exit code {process.returncode}:\n{printed}")


def _ends(process):
    """Whether a process that was interrupted ends in order and in time: closed, or before there was anything to close."""
    try:
        return process.wait(timeout=ENDING) in (0, -signal.SIGINT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return False


@pytest.fixture
def probe(ros):
    """A node in this process, to publish and listen with."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    context = Context()
    rclpy.init(context=context, domain_id=ros)
    node = rclpy.create_node("probe", context=context)
    executor = SingleThreadedExecutor(context=context)  # the node holds it weakly
    executor.add_node(node)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def until():
    """until(condition, node): spins `node` until the condition holds; fails after a bound."""

    def until(condition, node, bound=120.0):
        end = time.monotonic() + bound
        while not condition():
            assert time.monotonic() < end, f"not within {bound} s"
            node.executor.spin_once(timeout_sec=0.05)

    return until


@pytest.fixture
def stand_still(probe, until):
    """stand_still(process) stops a process by SIGSTOP for 1.1 times the lease of DDS, then continues it; `probe` spins meanwhile."""

    def stand_still(process):
        process.send_signal(signal.SIGSTOP)
        end = time.monotonic() + 1.1 * LEASE
        until(lambda: time.monotonic() > end, probe)
        process.send_signal(signal.SIGCONT)

    return stand_still
