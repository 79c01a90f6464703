"""A program that lets the arm move: it waits for the service arm/enable, calls it once and ends."""

from __future__ import annotations

import rclpy
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool
from tt_core.start import default_signals

ENABLE_TIMEOUT = 120.0  # s, longest wait for the service of the arm node: a cold start compiles kernels
ANSWER = 10.0  # s, longest wait for its answer


def main() -> int:
    """Call the service arm/enable and print its answer; return the exit code, 0 if the arm is enabled, else 1."""
    default_signals()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("enable", enable_rosout=False, start_parameter_services=False)
    service = node.resolve_service_name("arm/enable")
    client = node.create_client(SetBool, service)
    answer: SetBool.Response | None = None
    if client.wait_for_service(ENABLE_TIMEOUT):
        future = client.call_async(SetBool.Request(data=True))
        rclpy.spin_until_future_complete(node, future, timeout_sec=ANSWER)
        answer = future.result() if future.done() else None
        answered = answer.message if answer else f"no answer within {ANSWER:g} s"
    else:
        answered = f"not there within {ENABLE_TIMEOUT:g} s"
    print(f"{service}: {answered}", flush=True)
    rclpy.try_shutdown()
    node.destroy_node()
    return 0 if answer and answer.success else 1
