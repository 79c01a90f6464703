"""Tests of Presence: a node is known by name again after other nodes may have removed it from discovery."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from tt_core.ros.presence import NAME, PRESENCE_CHECK_INTERVAL, STANDSTILL, Presence
from tt_core.ros.qos import RELIABLE


@pytest.fixture
def announced(probe, until):
    """Return a function that waits until the Presence of the probe has created its second node and destroyed it again."""
    Presence(probe)

    def announced(others=0):
        until(lambda: probe.get_node_names().count(NAME) == 1 + others, probe)
        until(lambda: probe.get_node_names().count(NAME) == others, probe)

    return announced


@pytest.fixture
def other(ros):
    """Return a function that creates a node with a DDS participant of its own, as a node of another process has."""
    import rclpy
    from rclpy.context import Context

    contexts = []

    def other(name):
        contexts.append(Context())
        rclpy.init(context=contexts[-1], domain_id=ros)
        return rclpy.create_node(name, context=contexts[-1])

    yield other
    for context in contexts:
        context.try_shutdown()


def test_it_announces_itself_after_its_start_and_after_a_standstill(announced):
    announced()
    time.sleep(1.2 * STANDSTILL)  # no callback of the node runs meanwhile, as if its process was stopped
    announced()


def test_it_follows_one_that_announces_itself(announced, other):
    announced()
    following = other(NAME)
    announced(others=1)
    following.destroy_node()


def test_it_announces_itself_when_a_node_is_gone(probe, until, announced, other):
    announced()
    leaving = other("leaving")
    until(lambda: "leaving" in probe.get_node_names(), probe)
    seen = time.monotonic()
    until(
        lambda: time.monotonic() > seen + 2 * PRESENCE_CHECK_INTERVAL, probe
    )  # until the check of the Presence has run and knows the other node
    leaving.destroy_node()
    announced()


def test_a_node_is_known_and_heard_after_two_standstills(start, probe, until, stand_still):
    Presence(probe)
    heard = []
    probe.create_subscription(
        DiagnosticArray, "/diagnostics", lambda message: heard.extend(s.name for s in message.status if "racket" in s.name), RELIABLE
    )

    racket = start("tt_racket.racket_node", "--ros-args")
    until(lambda: heard, probe)
    for _ in range(2):
        stand_still(racket)
        end = time.monotonic() + 2.0
        until(lambda end=end: time.monotonic() > end, probe)
    heard.clear()
    until(lambda: heard and "racket" in probe.get_node_names(), probe)
