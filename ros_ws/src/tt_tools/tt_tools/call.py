"""Call a service with a request that is given on the command line, as `ros2 service call` does."""

from __future__ import annotations

import time
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from tt_core.errors import TtError

from .graph import discover, services
from .message_text import message_from_values, values_of
from .packages import full_name, interface

APPEARANCE_TIMEOUT = 10.0  # s, longest wait for the service to appear


def call(service: str, kind: str, values: str, period: float | None = None) -> None:
    """Call a service and print its response.

    Args:
        service: Name of the service.
        kind: Type of the service, e.g. std_srvs/srv/Trigger.
        values: The request as a YAML mapping of its fields.
        period: Time from one call to the next, s; None to call once.

    Raises:
        TtError: No node offers the service, it has another type, or the values do not fit the request.
        KeyboardInterrupt: The user has interrupted the command.
    """
    server = interface(kind)
    if not hasattr(server, "Request"):
        raise TtError("The passed type is not a service")
    request = message_from_values(server.Request, values_of(values))
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
            while not answer.done():  # spin in short turns, between which Python handles an interrupt
                rclpy.spin_until_future_complete(node, answer, timeout_sec=0.1)
            print(f"response:\n{answer.result()!r}\n", flush=True)
            if period is None:
                return
            time.sleep(max(0.0, last + period - time.monotonic()))
    finally:
        rclpy.try_shutdown()


def _wait(client: Any) -> None:
    """Wait until a service is ready. Raises TtError after APPEARANCE_TIMEOUT s."""
    end = time.monotonic() + APPEARANCE_TIMEOUT
    if not client.service_is_ready():
        print("waiting for service to become available...", flush=True)
    while not client.wait_for_service(0.1):
        if time.monotonic() > end:
            raise TtError(f"no node offers the service {client.srv_name}; waited {APPEARANCE_TIMEOUT:g} s for one")
