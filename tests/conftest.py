"""Real ROS for node tests: a domain of its own, on this machine only, every process ended."""

import os
import signal
import subprocess
import sys
import time

import pytest
from hypothesis import settings

settings.register_profile("kernels", deadline=None)  # the first call of a kernel may compile it
settings.load_profile("kernels")


@pytest.fixture
def ros(tmp_path, monkeypatch):
    """The number of a free domain; this process and its children are on it."""
    from domain_coordinator import domain_id

    with domain_id() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        yield domain


@pytest.fixture
def start(ros):
    """start("package.module", *args) runs a node in a process of its own; after the test it is interrupted and must have gone."""
    processes = []

    def start(module, *args):
        command = [sys.executable, "-m", module, *args]
        processes.append(subprocess.Popen(command, env=os.environ, stderr=subprocess.PIPE, text=True))
        return processes[-1]

    yield start
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            pytest.fail(f"{process.args} did not end on SIGINT within 10 s")


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

    def until(condition, node, bound=30.0):
        end = time.monotonic() + bound
        while not condition():
            assert time.monotonic() < end, f"not within {bound} s"
            node.executor.spin_once(timeout_sec=0.05)

    return until
