"""Let the whole robot play against a simulated ball launcher: start all nodes, launch balls, print a line for each, record everything.

Run by scripts/demo. The demo acts as the operator: it sets the goal of each return, launches balls, and reads what the nodes publish.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.physics import Physics
from tt_core.robots import DEFAULT_ROBOT, arm_file, robots
from tt_core.ros.convert import ball_from_message, goal_from_message, goal_to_message, seconds
from tt_core.ros.diagnostics import Event, read_status, read_warnings
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE
from tt_core.shared_memory import remove_leftovers
from tt_core.states import Array, BallState, ReturnGoal
from tt_racket.goal import GoalParams, default_goal
from tt_tools import launch
from tt_tools.graph import graph as graph_of_tools
from tt_tools.graph import nodes

from .demo_metrics import TABLE_HEADER, DemoMetrics, demo_metrics, table_line, true_ball
from .report import write_report

READY = 90.0  # s, longest wait for all nodes; their first start loads compiled kernels
BALL = 10.0  # s of simulated time, longest wait from a launch to the end of the ball
LONGEST_REST = 3.0  # s of simulated time, longest wait from the end of a ball to the next launch
SERVICE_TIMEOUT = 10.0  # s, longest wait for the answer of a service
LAUNCH_END_TIMEOUT = 30.0  # s, longest wait for `ros2 launch` to end its nodes
LOG = "log.txt"  # file of --out for the output of the nodes
VIEW_PORT = 8080  # port of the live view, if it is free
DEMO_NODES = {"record", "sim", "estimate", "predict", "racket", "arm", "markers"}
LINKS = {  # number of subscribers that each topic must have before the first launch
    "/camera/left/image_raw": 2,
    "/camera/right/image_raw": 2,
    "/ball/measured": 3,
    "/ball/path": 2,
    "/racket/strokes": 2,
}
SPIN_AXES = {"top": (0, -1, 0), "back": (0, 1, 0), "left": (0, 0, -1), "right": (0, 0, 1)}  # axis of the spin of each kind of shot


class Demo(Node):
    """Node of the demo: collects what the other nodes publish about the ball in play, and sends the goal of its return.

    Attributes:
        status: What the simulator reports of the ball when it is over, by key; None before.
        measured: The last measured ball; None before the first.
        latency_ms: Latency from the last camera frame to the first joint command, ms; None before this command.
        refusal: The last warning of a node; None without one.
        goal: Goal of the return that another node has published; None while there is none.
        rest: Time at which the arm is back in its waiting posture, s.
        over: Time at which the last ball was over, s.
        own: The last goal message that this node has published; None before the first.
    """

    def __init__(self) -> None:
        """Make the publisher, the clients of the services, and the subscriptions."""
        super().__init__("demo", enable_rosout=False)
        self.status: dict[str, str] | None = None
        self.measured: BallState | None = None
        self.latency_ms: float | None = None
        self.refusal: str | None = None
        self.goal: ReturnGoal | None = None
        self.rest = 0.0
        self.over = 0.0
        self.own: MultiDOFJointTrajectory | None = None
        self.asked = self.create_publisher(MultiDOFJointTrajectory, "/return/goal", LATCHED)
        self.launcher = self.create_client(Trigger, "/launcher/launch")
        self.enabler = self.create_client(SetBool, "/arm/enable")
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)
        self.create_subscription(Odometry, "/ball/measured", self.on_measured, RELIABLE)
        self.create_subscription(JointTrajectory, "/arm/swing", self.on_swing, LATEST)
        self.create_subscription(MultiDOFJointTrajectory, "/return/goal", self.on_goal, RELIABLE)

    def forget(self) -> None:
        """Forget what was collected about the last ball."""
        self.status, self.measured, self.latency_ms, self.refusal = None, None, None, None

    def on_measured(self, message: Odometry) -> None:
        """Keep the measured ball."""
        self.measured = ball_from_message(message)

    def ask(self, spin: Array) -> ReturnGoal:
        """Return the goal of the next return. Publish the default goal first, unless another node has published a goal.

        Args:
            spin: (3,) direction of the spin of the ball that comes, on which the default goal depends. Its length does not matter.
        """
        if self.goal is None:
            goal = default_goal(spin, GoalParams())
            self.own = goal_to_message(goal, self.get_clock().now().nanoseconds * 1e-9)
            self.asked.publish(self.own)
            return goal
        return self.goal

    def on_goal(self, message: MultiDOFJointTrajectory) -> None:
        """Keep a goal that another node has published, such as the live view."""
        if message != self.own:
            self.goal = goal_from_message(message)

    def on_swing(self, message: JointTrajectory) -> None:
        """Keep the time at which a planned swing (the joint motion of a stroke) ends."""
        self.rest = seconds(message.header.stamp) + seconds(message.points[-1].time_from_start)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Keep the report about a ball that is over, the latency of the first joint command, and the last warning."""
        for status in read_status(message):
            if status.event is Event.BALL_OVER:
                self.status, self.over = status.values, status.time
            elif status.event is Event.FIRST_COMMAND and self.latency_ms is None:
                self.latency_ms = float(status.values["latency_ms"])
        for warning in read_warnings(message):
            self.refusal = f"{warning.name}: {warning.message}"


@contextmanager
def launched_nodes(arguments: Sequence[str], log: IO[str]) -> Iterator[subprocess.Popen[str]]:
    """Start all nodes by `ros2 launch` for this context, and end them after it. The `ros2` on the PATH is used, or else our own.

    Args:
        arguments: Arguments of the launch file, NAME:=VALUE.
        log: File to which the output of all nodes is written.

    Yields:
        The process of `ros2 launch`.
    """
    ros2 = [found] if (found := shutil.which("ros2")) else [sys.executable, "-m", "tt_tools.ros2"]
    command = [*launch.END_WITH_PARENT, *ros2, "launch", "tt_bringup", "sim.launch.yaml", *arguments]
    child = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True, text=True)
    try:
        yield child
    finally:
        child.send_signal(signal.SIGINT)
        try:
            child.wait(LAUNCH_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()


class Waiter:
    """Waits for conditions, and spins the node of the demo meanwhile."""

    def __init__(self, demo: Demo, running: subprocess.Popen[str]) -> None:
        """Keep the node of the demo and the process of `ros2 launch`, whose end is an error in `wait`."""
        self._executor, self._running = SingleThreadedExecutor(), running
        self._executor.add_node(demo)

    def wait(self, condition: Callable[[], bool], bound: float, what: str) -> None:
        """Spin the node of the demo until a condition holds.

        Args:
            condition: Function that tells whether it holds.
            bound: Longest wait, s.
            what: What is waited for, for the text of an error.

        Raises:
            TtError: The condition does not hold in time, or `ros2 launch` has ended.
        """
        end = time.monotonic() + bound
        while not condition():
            if time.monotonic() > end:
                raise TtError(f"{what}: not within {bound:g} s")
            if self._running.poll() is not None:
                raise TtError(f"the nodes ended with exit code {self._running.returncode} while waiting for {what}")
            self._executor.spin_once(timeout_sec=0.02)

    def call(self, client: rclpy.client.Client, request: object) -> str:
        """Call a service, and return the `message` of its response.

        Args:
            client: Client of the service.
            request: The request.

        Raises:
            TtError: The service reports no success, or does not answer within SERVICE_TIMEOUT s.
        """
        future = client.call_async(request)
        self.wait(future.done, SERVICE_TIMEOUT, client.srv_name)
        if not future.result().success:
            raise TtError(f"{client.srv_name}: {future.result().message}")
        return str(future.result().message)


def play_balls(demo: Demo, waiter: Waiter, balls: int, rtf: float) -> list[DemoMetrics]:
    """Launch balls one after another and print a line for each.

    Args:
        demo: Node of the demo.
        waiter: Waits and spins this node.
        balls: Number of balls.
        rtf: Real-time factor: simulated seconds per second.

    Returns:
        The metrics of each ball.

    Raises:
        TtError: A ball does not end in time, or the launcher refuses to launch one.
    """
    scores = []
    for _ in range(balls):
        demo.forget()
        shot = waiter.call(demo.launcher, Trigger.Request())
        goal = demo.ask(np.array(SPIN_AXES[shot.split()[0]], float))
        waiter.wait(lambda: demo.status is not None, 10.0 + BALL / rtf, f"the end of the ball {shot}")
        assert demo.status is not None
        true = true_ball(demo.status, demo.measured.time, Physics.liu().air) if demo.measured else None
        scores.append(demo_metrics(demo.status, goal, demo.measured, demo.latency_ms, demo.refusal, true))
        print(table_line(scores[-1]), flush=True)
        again = time.monotonic() + min(max(demo.rest - demo.over, 0.0), LONGEST_REST) / rtf
        waiter.wait(lambda at=again: time.monotonic() >= at, 2.0 * LONGEST_REST / rtf, "the arm at rest")  # type: ignore[misc]
    return scores


def summary(scores: list[DemoMetrics]) -> str:
    """Return the last line of the output: how many balls were hit and landed, and the largest error of a measured spin."""
    hit, landed = sum(s.hit for s in scores), sum(s.landed for s in scores)
    errors = [s.spin_error_rpm for s in scores if s.spin_error_rpm is not None]
    worst = f"; spin measured within {max(errors):.0f} rpm" if errors else ""
    return f"{hit} of {len(scores)} hit, {landed} landed on the opponent's half{worst}"


def free_domain() -> None:
    """Set ROS_DOMAIN_ID to a domain that is unused on this machine, and reserve it for this process, unless the variable is set already."""
    if "ROS_DOMAIN_ID" not in os.environ:
        from domain_coordinator import domain_id

        stack = ExitStack()
        os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(domain_id()))
        free_domain.held = stack.pop_all()  # type: ignore[attr-defined]


def refuse_neighbours() -> None:
    """Raise TtError if there are other nodes on the ROS domain, because their messages and ours would mix."""
    with graph_of_tools() as node:
        others = nodes(node)
    if others:
        raise TtError(f"domain {os.environ['ROS_DOMAIN_ID']} has nodes already: {', '.join(others)}; end them or set another ROS_DOMAIN_ID")


def arguments() -> argparse.Namespace:
    """Parse and check the command line; an invalid one ends the process with a message. Makes the output folder."""
    parser = argparse.ArgumentParser(prog="scripts/demo", description=__doc__)
    parser.add_argument("--balls", type=int, default=6, metavar="N", help="how many balls (default 6)")
    parser.add_argument(
        "--robot", default=DEFAULT_ROBOT, metavar="ARM", help=f"an arm that comes with it, or an arm file (default {DEFAULT_ROBOT})"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all that is random (default 0)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--rtf", type=float, default=1.0, metavar="R", help="simulated seconds in a second (default 1)")
    parser.add_argument("--view", action="store_true", help="show it live in a browser, and go on after the last ball until Ctrl-C")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to record (default out/demo_<time>)")
    args = parser.parse_args()
    for name, value, low, high in (("balls", args.balls, 1, 10**6), ("rtf", args.rtf, 0.01, 10.0), ("seed", args.seed, 0, 2**31)):
        if not low <= value <= high:
            parser.error(f"--{name} {value:g} is outside [{low:g}, {high:g}]")
    try:
        args.robot = args.robot if args.robot in robots() else str(arm_file(args.robot).absolute())
    except TtError as error:
        parser.error(f"--robot {error}")
    args.out = args.out or Path("out") / time.strftime("demo_%Y%m%d_%H%M%S")
    if (args.out / "bag").exists():
        parser.error(f"--out {args.out} holds a recording already")
    try:  # an output that cannot be written is an error before the run, not after it
        args.out.mkdir(parents=True, exist_ok=True)
        for path in (args.out / LOG, *filter(None, [args.json])):
            path.touch()
    except OSError as error:
        parser.error(f"cannot write: {error}")
    return args


def free_port() -> int:
    """Return a free port of 127.0.0.1: VIEW_PORT if it is free, otherwise any other."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", VIEW_PORT))
        except OSError:
            probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def stay(waiter: Waiter) -> None:
    """Keep all nodes running until Ctrl-C, so that the live view can be used."""
    with suppress(KeyboardInterrupt):
        print("the page stays until Ctrl-C; its buttons launch balls", flush=True)
        waiter.wait(lambda: False, math.inf, "Ctrl-C")


def start_robot(demo: Demo, waiter: Waiter, nodes: set[str]) -> None:
    """Wait until all nodes are there and are connected, then enable the arm and wait for its first command.

    Args:
        demo: Node of the demo.
        waiter: Waits and spins this node.
        nodes: Names of all nodes that must be there.

    Raises:
        TtError: Something does not happen in time, or the arm is not enabled.
    """
    there = lambda: demo.launcher.service_is_ready() and demo.enabler.service_is_ready()  # noqa: E731
    waiter.wait(lambda: set(demo.get_node_names()) >= nodes and there(), READY, "all nodes")
    waiter.wait(lambda: all(demo.count_subscribers(topic) >= n for topic, n in LINKS.items()), READY, f"subscribers of {', '.join(LINKS)}")
    waiter.call(demo.enabler, SetBool.Request(data=True))
    commands: list[Float64MultiArray] = []  # a command is the answer to a joint state, so it shows that both ways are connected
    listening = demo.create_subscription(Float64MultiArray, "/arm_velocity_controller/commands", commands.append, LATEST)
    waiter.wait(lambda: bool(commands), READY, "a command of the arm")
    demo.destroy_subscription(listening)


def main() -> None:
    """Run the command line: play the demo, and write its recording, its report and, if asked for, its figures as JSON."""
    args = arguments()
    out = args.out.absolute()
    free_domain()
    simulated = "false" if args.rtf == 1.0 else "true"
    given: dict[str, object] = {"rtf": args.rtf, "seed": args.seed, "use_sim_time": simulated, "physics": "liu", "robot": args.robot}
    given |= {"record": "true", "output": out / "bag"}
    given["enabled"] = "false"  # `start_robot` enables the arm when all nodes are there
    nodes = DEMO_NODES | ({"view"} if args.view else set())
    if args.view:  # only simulated time can be paused
        given |= {"view": "true", "view_port": free_port(), "use_sim_time": "true"}
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    log = (out / LOG).open("w", buffering=1)
    try:
        remove_leftovers()
        refuse_neighbours()
        with launched_nodes([f"{name}:={value}" for name, value in given.items()], log) as running:
            rclpy.init()
            try:
                demo = Demo()
                waiter = Waiter(demo, running)
                print(f"starting {len(nodes)} nodes on domain {os.environ['ROS_DOMAIN_ID']}", flush=True)
                start_robot(demo, waiter, nodes)
                if args.view:
                    print(f"live view: http://127.0.0.1:{given['view_port']}/", flush=True)
                print(TABLE_HEADER, flush=True)
                scores = play_balls(demo, waiter, args.balls, args.rtf)
                if args.view:
                    stay(waiter)
            finally:
                rclpy.try_shutdown()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except TtError as error:
        print(f"demo: {error}; the output of the nodes is in {out / LOG}", file=sys.stderr)
        raise SystemExit(1) from error
    print(summary(scores))
    bag, report = args.out / "bag", args.out / "report.html"
    try:
        if args.json:
            args.json.write_text(json.dumps({"balls": [s.as_dict() for s in scores], "bag": str(bag)}, indent=1) + "\n")
        write_report(bag, report)
    except (TtError, OSError) as error:
        print(f"demo: not written: {error}", file=sys.stderr)
        raise SystemExit(1) from error
    parts = sorted(args.out.glob("bag*"))  # a recorder that had to start anew on a busy machine has written a second bag
    print(f"recorded: {', '.join(map(str, parts))}\nfigures:  {report}")
    if running.returncode:
        print(f"demo: the nodes ended with exit code {running.returncode}; see {out / LOG}", file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    main()
