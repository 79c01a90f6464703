"""Show the robot live in a browser: 3D scene, camera images, latencies, diagnostics, and buttons that drive it.

The node only subscribes, except when a user presses a button. It shows a running robot and a bag that is being played in the same way.
"""

from __future__ import annotations

import re
import secrets
import socket
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Any

import viser
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.priority import Priority
from tt_core.ros.convert import ball_from_message, goal_to_message, image_from_message
from tt_core.ros.diagnostics import Event, Status, read_status
from tt_core.ros.inputs import STATE_FORM, Input, MessageForm
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, NEWEST, SENSOR
from tt_vision.rig import SIDES

from .view.actions import Action, Enable, Launch, Pause, SetGoal, SetRate, Step, Stop
from .view.gate import Gate, is_loopback
from .view.page import Page
from .view.readings import Health, Readings
from .view.scene_inputs import SceneInputs

NICE = 10  # priority of the process: the robot comes first
UPDATES_PER_PANEL = 6  # the panels are updated once in so many updates of the scene
IMAGES = 0.01  # s, shortest time between two images of a camera that are read
SHOWN_IMAGE_FORM = MessageForm(Image, 2**26)
SHOWN_STAGES = (
    Event.FIRST_ESTIMATE,
    Event.MEASURED,
    Event.PATH,
    Event.STROKES,
    Event.SWING,
    Event.FIRST_COMMAND,
)  # latencies that are shown


@dataclass(frozen=True)
class ViewParams:
    """Parameters of the node: where the page is served, and how often it is updated."""

    host: str = param("127.0.0.1", "", "address on which the page is served; 0.0.0.0: on all")
    port: int = param(8080, "", "port of the page; 0: any that is free", low=0, high=65535)
    token: str = param(
        "", "", "what the address must hold as ?token=, of letters, digits, - and _; empty: none on this machine, else a random one"
    )
    rate: float = param(30.0, "1/s", "updates of the page", low=1.0, high=60.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a token with other characters than letters, digits, - and _."""
        check(self)
        if not re.fullmatch(r"[\w-]*", self.token, re.ASCII):
            raise TtError("token holds other characters than letters, digits, - and _")


class ViewNode(Node):
    """Node that serves the live view. It subscribes to everything that the view shows.

    When a user presses a button, it calls a service, sets parameters of the node sim, or publishes the goal of the return on return/goal.
    """

    def __init__(self) -> None:
        """Declare the parameters, serve the page, then subscribe."""
        super().__init__("view")
        params = declare(self, ViewParams)
        physics, self.status, self.readings = declare_physics(self), Status(self), Readings()
        token = params.token or ("" if is_loopback(params.host) else secrets.token_urlsafe(16))
        self.gate = Gate(params.host, params.port, token)
        with redirect_stdout(StringIO()):  # viser would print its own address, which users reach through the gate only
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.gate.open(self.server.get_port())
        self.page, self.updates = Page(self.server), 0
        self.inputs = SceneInputs(self, physics, self.status, 1.0 / params.rate, self.on_diagnostics)
        self.subscribe(0.5 / params.rate)
        self.goals = self.create_publisher(MultiDOFJointTrajectory, "return/goal", LATCHED)
        self.launcher, self.setter = self.create_client(Trigger, "launcher/launch"), self.create_client(SetParameters, "sim/set_parameters")
        self.enabler, self.stopper = self.create_client(SetBool, "arm/enable"), self.create_client(Trigger, "arm/stop")
        self.pauser, self.stepper = self.create_client(SetBool, "sim/pause"), self.create_client(Trigger, "sim/step")
        self.create_timer(1.0 / params.rate, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        host = socket.gethostname() if params.host in ("0.0.0.0", "::") else params.host
        self.get_logger().info(f"http://{host}:{self.gate.port}/" + (f"?token={token}" if token else ""))

    def subscribe(self, interval: float) -> None:
        """Subscribe to the true ball of a simulator and to the camera images.

        Args:
            interval: Shortest time between two true balls that are read, s.
        """
        refused = self.inputs.refused
        Input(self, STATE_FORM, "sim/ball", self.on_true_ball, SENSOR, refused=refused, interval=interval)
        for side in SIDES:
            on_image = lambda message, side=side: self.on_image(side, message)  # noqa: E731
            topic = f"camera/{side}/image_raw"
            Input(self, SHOWN_IMAGE_FORM, topic, on_image, NEWEST, refused=refused, interval=IMAGES)

    def on_true_ball(self, message: Odometry) -> None:
        """Give the true ball of the simulator to the scene."""
        try:
            self.inputs.scene.take_true_ball(ball_from_message(message), self.inputs.now())
        except TtError as error:
            self.inputs.refused(error)

    def on_image(self, side: str, message: Image) -> None:
        """Keep a camera image for the panel. side: name of the camera, one of SIDES."""
        try:
            self.readings.take_image(side, image_from_message(message), self.inputs.now())
        except TtError as error:
            self.inputs.refused(error)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep the statuses and latencies for the panels."""
        now = self.inputs.now()
        self.readings.take_health(Health(now, s.name, int.from_bytes(s.level, "little"), s.message) for s in message.status)
        for status in read_status(message):
            if status.event in SHOWN_STAGES and "latency_ms" in status.values:
                self.readings.take_latency(status.event.value, float(status.values["latency_ms"]))

    def on_timer(self) -> None:
        """Carry out the actions that users have asked for, and update the page if somebody has it open."""
        while not self.page.actions.empty():
            self.do(self.page.actions.get())
        if not self.gate.watchers:
            return
        now = self.inputs.now()
        self.page.draw(self.inputs.scene.items(now))
        if self.updates % UPDATES_PER_PANEL == 0:
            self.page.show(self.inputs.scene, self.readings, now)
        self.updates += 1

    def do(self, action: Action) -> None:
        """Carry out an action that a user has asked for."""
        if isinstance(action, Launch):
            launch = lambda: self.call(self.launcher, Trigger.Request())  # noqa: E731
            self.set_launcher(action.shot, 0.0, then=launch)
        elif isinstance(action, SetRate):
            self.set_launcher(action.shot, action.rate)
        elif isinstance(action, SetGoal):
            self.goals.publish(goal_to_message(action.goal, self.inputs.now()))
            self.readings.shown = f"landing asked for: {action.goal.landing[0]:.2f}, {action.goal.landing[1]:.2f} m"
        elif isinstance(action, Enable):
            self.call(self.enabler, SetBool.Request(data=True))
        elif isinstance(action, Stop):
            self.call(self.stopper, Trigger.Request())
        elif isinstance(action, Pause):
            self.call(self.pauser, SetBool.Request(data=action.on))
        elif isinstance(action, Step):
            self.call(self.stepper, Trigger.Request())

    def set_launcher(self, shot: str, rate: float, then: Callable[[], None] | None = None) -> None:
        """Set what the simulated launcher launches, and how often.

        Args:
            shot: Kind and scale of the balls, e.g. "top 3".
            rate: Balls per minute; 0 for balls on request only.
            then: Called when the node sim has accepted both; None for nothing.
        """
        shots = ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=[shot])
        often = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=rate)
        request = SetParameters.Request(parameters=[Parameter(name="shots", value=shots), Parameter(name="launcher.rate", value=often)])

        def on_answer(answer: SetParameters.Response) -> None:
            reasons = [result.reason for result in answer.results if not result.successful]
            self.readings.shown = "; ".join(reasons) or (f"{shot}, {rate:g} balls a minute" if rate else f"{shot}, on request")
            if not reasons and then is not None:
                then()

        self.call(self.setter, request, on_answer)

    def call(self, client: Client, request: Any, on_answer: Callable[[Any], None] | None = None) -> None:
        """Call a service without waiting for its answer; if it is not available, show that.

        Args:
            client: Client of the service.
            request: The request.
            on_answer: Called with the response; None to show the message of the response on the page.
        """
        if not client.service_is_ready():
            self.readings.shown = f"{client.srv_name} is not there"
            return
        show = on_answer or (lambda answer: setattr(self.readings, "shown", f"{client.srv_name}: {answer.message}"))
        client.call_async(request).add_done_callback(lambda future: show(future.result()))

    def close(self) -> None:
        """Stop serving the page."""
        self.gate.close()
        with redirect_stdout(StringIO()):
            self.server.stop()


def main() -> None:
    """Run the node."""
    run(ViewNode, Priority(nice=NICE))


if __name__ == "__main__":
    main()
