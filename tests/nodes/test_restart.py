"""Tests of the restart after a standstill: a new process with the present parameters; only an arm that was enabled is enabled."""

import re
import signal
import time
import urllib.request

import pytest
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import SetBool
from tt_core.ros.restart import LONGEST_STANDSTILL, watch_standstill


@pytest.fixture
def parameters(probe, until):
    """Return functions that set and get parameters of a node; they ask until they are answered."""

    class Parameters:
        def __init__(self, node):
            self.client = AsyncParameterClient(probe, node)

        def set(self, name, value):
            until(self.client.services_are_ready, probe)
            done = self.client.set_parameters([Parameter(name, value=value)])
            until(done.done, probe)
            assert done.result().results[0].successful

        def get(self, *names):
            asked = self.client.get_parameters(names)
            end = time.monotonic() + 2.0
            until(lambda: asked.done() or time.monotonic() > end, probe)  # a question to the old process is never answered
            if not asked.done() or not asked.result().values:
                return None
            return [parameter_value_to_python(value) for value in asked.result().values]

    return Parameters


def endpoints(probe, topic):
    return {bytes(info.endpoint_gid) for info in probe.get_publishers_info_by_topic(topic)}


def test_a_callback_that_takes_long_is_no_standstill():
    found = []
    with watch_standstill(found.append):
        time.sleep(1.5 * LONGEST_STANDSTILL)  # the thread of the callback waits, that of the watch does not
    assert not found


def test_a_view_goes_on(start, until, probe):
    """A view that stood still is not restarted, because a process of low priority often stands still on a busy machine."""
    view, printed = start("tt_bringup.view_node", "--ros-args", "-p", "port:=0"), []

    def addresses():
        printed.append(view.stderr.read())
        return re.findall(r"http://\S+", "".join(printed))

    def passed(seconds):
        end = time.monotonic() + seconds
        return lambda: time.monotonic() > end

    until(lambda: addresses() and "ready" in "".join(printed), probe)
    view.send_signal(signal.SIGSTOP)
    until(passed(LONGEST_STANDSTILL + 0.2), probe)  # long enough to be noticed, too short for DDS to forget the node
    view.send_signal(signal.SIGCONT)
    until(passed(1.0), probe)  # four times the interval of the watch
    with urllib.request.urlopen(addresses()[0], timeout=120.0) as page:
        assert page.status == 200
    assert len(addresses()) == 1


def test_a_new_process_has_the_present_parameters(start, probe, until, parameters, stand_still):
    racket, of_racket = start("tt_racket.racket_node", "--ros-args", "-p", "goal.landing_x:=2.2"), parameters("racket")
    of_racket.set("goal.landing_y", 0.5)
    before = endpoints(probe, "/racket/strokes")
    stand_still(racket)
    until(lambda: (now := endpoints(probe, "/racket/strokes")) and not now & before, probe)
    until(lambda: of_racket.get("goal.landing_x", "goal.landing_y") == [2.2, 0.5], probe)
    assert racket.poll() is None


@pytest.mark.parametrize("is_enabled", [True, False])
def test_an_arm_is_enabled_if_it_was(start, probe, until, parameters, stand_still, is_enabled):
    arm, of_arm = start("tt_arm.arm_node", "--ros-args", "-p", f"enabled:={not is_enabled}".lower()), parameters("arm")
    of_arm.set("speed_scale", 0.5)
    enable = probe.create_client(SetBool, "/arm/enable")
    until(enable.service_is_ready, probe)
    until(enable.call_async(SetBool.Request(data=is_enabled)).done, probe)
    stand_still(arm)
    until(lambda: of_arm.get("enabled", "speed_scale") == [is_enabled, 0.5], probe)
    assert arm.poll() is None
