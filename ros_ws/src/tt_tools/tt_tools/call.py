"""Calls a service with values that the command line gives, as `ros2 service call`."""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from tt_core.errors import TtError

from .graph import discover, services
from .message_text import from_values, values_of
from .packages import full_name, interface

PATIENCE = 10.0  # s for the service to be there


def call(service: str, kind: str, values: str, period: float | None = None) -> None:
    """Call a service and print its response.

    Args:
        service: Its name.
        kind: Its type, e.g. std_srvs/srv/Trigger.
        values: The request as a YAML mapping.
        period: s between two calls; one call if None.

    Raises:
        TtError: Nobody serves it, or with another type, or the values are none of the type.
        KeyboardInterrupt: On an interrupt.
    """
    server = interface(kind)
    if not hasattr(server, "Request"):
        raise TtError("The passed type is not a service")
    request = from_values(server.Request, values_of(values))
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("_ros2cli_requester", enable_rosout=False, start_parameter_services=False)
        discover(node)
        served = services(node, hidden=True).get(node.resolve_service_name(service), [full_name(kind, "srv")])
        if full_name(kind, "srv") not in served:
            raise TtError(f"{service} has the type {', '.join(served)}, not {kind}")
        client = node.create_client(server, service)
        _wait(client)
        while True:
            last = time.monotonic()
            print(f"requester: making request: {request!r}\n", flush=True)
            answer = client.call_async(request)
            while not answer.done():  # in short turns, between which an interrupt is seen
                rclpy.spin_until_future_complete(node, answer, timeout_sec=0.1)
            print(f"response:\n{answer.result()!r}\n", flush=True)
            if period is None:
                return
            time.sleep(max(0.0, last + period - time.monotonic()))
    finally:
        rclpy.try_shutdown()


def _wait(client: Any) -> None:
    """Wait for a service. Raises TtError if it does not come."""
    end = time.monotonic() + PATIENCE
    if not client.service_is_ready():
        print("waiting for service to become available...", flush=True)
    while not client.wait_for_service(0.1):
        if time.monotonic() > end:
            raise TtError(f"no node has served {client.srv_name} for {PATIENCE:g} s")
