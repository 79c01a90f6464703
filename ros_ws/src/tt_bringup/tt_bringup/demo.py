"""The whole robot against the simulated catapult: starts the graph, launches balls, prints a line for each, records everything.

Run by scripts/demo. Plays the operator: asks for a return, launches, and looks at what the nodes tell; it never talks to a node in between.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

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
from tt_core.ros.convert import ball_from_message, goal_to_message, seconds
from tt_core.ros.diagnostics import read_status
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE
from tt_core.states import BallState, ReturnGoal
from tt_racket.goal import GoalParams, default_goal
from tt_tools import launch, packages

from .demo_metrics import HEADER, DemoMetrics, demo_metrics, line
from .report import page

READY = 90.0  # s until every node must be there; a cold start loads compiled kernels
BALL = 10.0  # s, simulated, from a launch to the end of the ball
LONGEST_REST = 3.0  # s, simulated, from the end of a ball to the next launch
SPINS = {"top": (0, -1, 0), "back": (0, 1, 0), "left": (0, 0, -1), "right": (0, 0, 1)}  # axis of each kind of shot


class Demo(Node):
    """Collects what the nodes tell about the ball in play."""

    def __init__(self) -> None:
        super().__init__("demo", enable_rosout=False)
        self.told: dict[str, str] | None = None
        self.measured: BallState | None = None
        self.latency_ms: float | None = None
        self.refusal: str | None = None
        self.rest = 0.0  # s, sim time, when the arm is back
        self.over = 0.0  # s, sim time, when the last ball was
        self.asked = self.create_publisher(MultiDOFJointTrajectory, "/return/goal", LATCHED)
        self.launcher = self.create_client(Trigger, "/launcher/launch")
        self.enabler = self.create_client(SetBool, "/arm/enable")
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)
        self.create_subscription(Odometry, "/ball/measured", self.on_measured, RELIABLE)
        self.create_subscription(JointTrajectory, "/arm/swing", self.on_swing, LATEST)

    def forget(self) -> None:
        self.told, self.measured, self.latency_ms, self.refusal = None, None, None, None

    def on_measured(self, message: Odometry) -> None:
        self.measured = ball_from_message(message)

    def on_swing(self, message: JointTrajectory) -> None:
        self.rest = seconds(message.header.stamp) + seconds(message.points[-1].time_from_start)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for time_told, name, text, values in read_status(message):
            if name == "sim" and text == "ball over":
                self.told, self.over = values, time_told
            elif name == "arm" and text == "first command" and self.latency_ms is None:
                self.latency_ms = float(values["latency_ms"])
        for status in message.status:
            if status.level != status.OK:
                self.refusal = f"{status.name}: {status.message}"


def wait(condition: Callable[[], bool], node: Node, executor: SingleThreadedExecutor, bound: float, what: str) -> None:
    """Spin until the condition holds; raises TtError after `bound` s."""
    end = time.monotonic() + bound
    while not condition():
        if time.monotonic() > end:
            raise TtError(f"{what}: not within {bound:g} s")
        executor.spin_once(timeout_sec=0.02)


def call(client: rclpy.client.Client, request: object, node: Node, executor: SingleThreadedExecutor, what: str) -> str:
    """The message of a service that succeeds; raises TtError when it refuses."""
    future = client.call_async(request)
    wait(future.done, node, executor, 10.0, what)
    if not future.result().success:
        raise TtError(f"{what}: {future.result().message}")
    return str(future.result().message)


def play(demo: Demo, executor: SingleThreadedExecutor, balls: int, rtf: float) -> list[DemoMetrics]:
    """Launch `balls` one after another and print a line for each."""
    scores = []
    for _ in range(balls):
        demo.forget()
        shot = call(demo.launcher, Trigger.Request(), demo, executor, "/launcher/launch")
        goal: ReturnGoal = default_goal(np.array(SPINS[shot.split()[0]], float), GoalParams())
        demo.asked.publish(goal_to_message(goal, demo.get_clock().now().nanoseconds * 1e-9))
        wait(lambda: demo.told is not None, demo, executor, 10.0 + BALL / rtf, f"the end of the ball {shot}")
        assert demo.told is not None
        scores.append(demo_metrics(demo.told, goal, demo.measured, demo.latency_ms, demo.refusal, Physics.liu().air))
        print(line(scores[-1]), flush=True)
        again = time.monotonic() + min(max(demo.rest - demo.over, 0.0), LONGEST_REST) / rtf
        wait(lambda at=again: time.monotonic() >= at, demo, executor, 2.0 * LONGEST_REST / rtf, "the arm at rest")  # type: ignore[misc]
    return scores


def summary(scores: list[DemoMetrics]) -> str:
    hit, landed = sum(s.hit for s in scores), sum(s.landed for s in scores)
    errors = [s.spin_error_rpm for s in scores if s.spin_error_rpm is not None]
    worst = f"; spin measured within {max(errors):.0f} rpm" if errors else ""
    return f"{hit} of {len(scores)} hit, {landed} landed on the opponent's half{worst}"


def free_domain() -> None:
    """A domain of our own unless one is set, so that no other graph on this machine is met."""
    if "ROS_DOMAIN_ID" not in os.environ:
        from domain_coordinator import domain_id

        stack = ExitStack()
        os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(domain_id()))
        free_domain.held = stack.pop_all()  # type: ignore[attr-defined]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/demo", description=__doc__)
    parser.add_argument("--balls", type=int, default=6, metavar="N", help="how many balls (default 6)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all that is random (default 0)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--rtf", type=float, default=1.0, metavar="R", help="simulated seconds in a second (default 1)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to record (default out/demo_<time>)")
    args = parser.parse_args()
    if args.balls < 1 or not 0.01 <= args.rtf <= 10.0 or args.seed < 0:
        parser.error(f"--balls {args.balls} must be at least 1, --rtf {args.rtf:g} in [0.01, 10], --seed {args.seed} not negative")
    return args


def main() -> None:
    args = arguments()
    out = args.out or Path("out") / time.strftime("demo_%Y%m%d_%H%M%S")
    out.mkdir(parents=True, exist_ok=True)
    free_domain()
    given = {"rtf": str(args.rtf), "seed": str(args.seed), "use_sim_time": "false" if args.rtf == 1.0 else "true", "physics": "liu"}
    given["enabled"] = "false"  # it is enabled here, when all nodes are there
    processes = launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), given)
    recorder = (str(packages.executable("tt_tools", "record_node")), "--ros-args", "-p", f"output:='{out / 'bag'}'")
    processes = [launch.Process("record", recorder), *processes]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    log = (out / "log.txt").open("w", buffering=1)
    try:
        with ExitStack() as stack:
            system = stack.enter_context(launch.System(processes, lambda text: print(text, file=log)))
            rclpy.init()
            stack.callback(rclpy.try_shutdown)
            demo, executor = Demo(), SingleThreadedExecutor()
            executor.add_node(demo)
            print(f"starting {len(processes)} nodes on domain {os.environ['ROS_DOMAIN_ID']}", flush=True)
            nodes = {p.name for p in processes}
            wait(
                lambda: nodes <= set(demo.get_node_names()) and demo.launcher.service_is_ready() and demo.enabler.service_is_ready(),
                demo,
                executor,
                READY,
                "all nodes there",
            )
            links = {"/camera/left/image_raw": 2, "/camera/right/image_raw": 2, "/ball/measured": 3, "/ball/path": 2, "/racket/strokes": 2}
            wait(lambda: all(demo.count_subscribers(t) >= n for t, n in links.items()), demo, executor, READY, f"listeners on {links}")
            call(demo.enabler, SetBool.Request(data=True), demo, executor, "/arm/enable")
            answered: list[Float64MultiArray] = []  # a command is the arm's answer to a joint state: both ways are open
            listening = demo.create_subscription(Float64MultiArray, "/arm_velocity_controller/commands", answered.append, LATEST)
            wait(lambda: bool(answered), demo, executor, READY, "a command of the arm")
            demo.destroy_subscription(listening)
            print(HEADER, flush=True)
            scores = play(demo, executor, args.balls, args.rtf)
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except TtError as error:
        print(f"demo: {error}; the nodes' own words are in {out / 'log.txt'}", file=sys.stderr)
        raise SystemExit(1) from error
    print(summary(scores))
    (out / "report.html").write_text(page(out / "bag", scores))
    print(f"recorded: {out / 'bag'}\nfigures:  {out / 'report.html'}")
    if args.json:
        args.json.write_text(json.dumps({"balls": [s.as_dict() for s in scores], "bag": str(out / "bag")}, indent=1) + "\n")
    if system.failed:
        print(f"demo: failed: {system.failed}; see {out / 'log.txt'}", file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    main()
