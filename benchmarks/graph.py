"""The graph under test: the nodes of sim.launch.yaml as processes, what they tell, and ways to disturb them. Used by other benchmarks."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from tt_core.priority import CONTROL, set_thread_realtime
from tt_core.ros.convert import seconds
from tt_core.ros.diagnostics import Event, read_status, read_warnings
from tt_core.ros.qos import RELIABLE, TRUTH
from tt_tools import launch, packages

READY = 120.0  # s until the first ball is hit
RECOVERY = 30.0  # s until a ball is hit after a fault
MOVES = 0.3  # rad/s of the fastest joint, above which the arm swings
RESTS = 0.02  # rad/s, below which it rests
NEAR = 0.15  # m from the ball to the racket: 30 ms before the strike
BEGUN = 1.6  # m in x: a ball that is nearer to the robot has been measured
THROUGH = "/through"  # before the name of a topic that a relay passes on
NODES = ("sim", "estimate", "predict", "racket", "arm", "record")  # that are to live as long as the graph
PHASES = ("waiting", "launched", "swing", "strike", "back")


@dataclass(frozen=True)
class Ball:
    """One that is over. launched, over: s, simulated."""

    number: int
    launched: float
    over: float
    hit: bool
    result: str


@dataclass(frozen=True)
class Warning:
    """What a node told at a level above OK. time: s, simulated or of the system, as the node's clock."""

    time: float
    name: str
    text: str


class Watch(Node):
    """Listens to what the nodes and the true arm do.

    Attributes:
        balls: Those that are over.
        warnings: The newest of the nodes.
        latencies: (s told, ms) from a ball's last frame to the first command for it.
        record: The newest "sim: arm record", and when it came, s.
        speeds: (s, rad/s) of the fastest joint.
    """

    def __init__(self, joints_topic: str, tell: Callable[[str], None]) -> None:
        """Begin to listen.

        Args:
            joints_topic: Where the true joints are published.
            tell: Takes a line for each warning.
        """
        super().__init__("watch", enable_rosout=False, start_parameter_services=False)
        self._tell = tell
        self.balls = deque[Ball](maxlen=10_000)
        self.warnings = deque[Warning](maxlen=20_000)
        self.latencies = deque[tuple[float, float]](maxlen=10_000)
        self.record: tuple[float, dict[str, str]] = (-np.inf, {})
        self.speeds = deque[tuple[float, float]](maxlen=20_000)
        self.changed = threading.Condition()
        self.phase = "none"
        self._ball, self._racket, self._rested = (np.inf, np.zeros(3), 0.0), np.full(3, np.inf), 0.0
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, RELIABLE)
        self.create_subscription(JointState, joints_topic, self._on_joints, RELIABLE)
        self.create_subscription(Odometry, "/sim/ball", self._on_ball, TRUTH)
        self.create_subscription(Odometry, "/sim/racket", self._on_racket, TRUTH)
        self.enabler = self.create_client(SetBool, "/arm/enable")

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in read_status(message):
            values = status.values
            if status.event is Event.BALL_OVER:
                launched, hit = json.loads(values["launched"])[0], json.loads(values["hit"]) is not None
                self.balls.append(Ball(int(values["number"]), launched, status.time, hit, values["result"]))
            elif status.name == "sim: arm record":
                self.record = time.time(), values
            elif status.event is Event.FIRST_COMMAND and "latency_ms" in values:
                self.latencies.append((status.time, float(values["latency_ms"])))
        for s in read_warnings(message):
            reasons = s.values.get("reasons")
            warning = Warning(s.time, s.name, f"{s.message}: {reasons}" if reasons else s.message)
            self.warnings.append(warning)
            self._tell(f"[{warning.name}] warns: {warning.text}")
        with self.changed:
            self.changed.notify_all()

    def _on_ball(self, message: Odometry) -> None:
        position = message.pose.pose.position
        place = np.array([position.x, position.y, position.z])
        self._ball = time.monotonic(), place, message.twist.twist.linear.x

    def _on_racket(self, message: Odometry) -> None:
        position = message.pose.pose.position
        self._racket = np.array([position.x, position.y, position.z])

    def _on_joints(self, message: JointState) -> None:
        speed, now = max(map(abs, message.velocity), default=0.0), time.monotonic()
        self.speeds.append((seconds(message.header.stamp), speed))
        seen, place, forwards = self._ball
        flies, moves = now - seen < 0.05, speed > MOVES
        self._rested = self._rested if speed < RESTS and not flies else now
        if flies and forwards < 0.0:
            near = np.linalg.norm(place - self._racket) < NEAR
            phase = "strike" if near and moves else "swing" if moves and place[0] < BEGUN else "launched" if place[0] > 2.4 else "flying"
        else:
            phase = "back" if moves else "waiting" if now - self._rested > 0.05 else "none"
        if phase != self.phase:
            self.phase = phase
            with self.changed:
                self.changed.notify_all()

    def hit_since(self, time: float) -> bool:
        """Whether a ball launched after `time` (s, simulated) was hit."""
        return any(ball.hit and ball.launched > time for ball in tuple(self.balls))

    def broken(self) -> str | None:
        """The bound that the true arm has broken since sim_node started, or None."""
        values = self.record[1]
        if not values:
            return "no record of the arm"
        if float(values["speed"]) > 1.0 + 1e-6:
            return f"speed {values['speed']} of its limit"
        if int(values["end_stop_hits"]) > 0:
            return f"end stop hit {values['end_stop_hits']} times"
        return f"clearance {values['clearance']} m to {values['nearest']}" if float(values["clearance"]) <= 0.0 else None

    def reaction(self, since: float) -> float | None:
        """Measure how late the arm began to brake.

        Args:
            since: s, simulated, when it should have known.

        Returns:
            ms from there to the last gain of speed before rest; None if the arm rested then, or did not come to rest in 1.5 s.
        """
        rows = np.array([row for row in tuple(self.speeds) if since - 0.01 < row[0] < since + 1.5])
        after = rows[rows[:, 0] >= since] if len(rows) else rows
        if len(after) < 2 or rows[0, 1] < MOVES or not (after[:, 1] < RESTS).any():
            return None
        until_rest = after[: int(np.argmax(after[:, 1] < RESTS)) + 1]
        gains = np.flatnonzero(np.diff(until_rest[:, 1]) > 0.0)
        return 1e3 * (until_rest[gains[-1] + 1, 0] - since) if len(gains) else 0.0


class Relay:
    """Passes on a topic, whose publisher has been remapped to THROUGH; `change` makes what is passed on from each message.

    It keeps the newest message only, as the nodes do. A longer queue would hand on commands from before a delay as new ones.
    """

    def __init__(self, node: Node, topic: str, kind: type) -> None:
        self.kind, self.topic, self.passed = kind, topic, 0  # passed: messages
        self.change: Callable[[Any], Any] | None = None  # -> a message, its bytes, or None for nothing
        self.publisher = node.create_publisher(kind, topic, QoSProfile(depth=1))
        node.create_subscription(kind, THROUGH + topic, self._on_data, QoSProfile(depth=1), raw=True)

    def _on_data(self, data: bytes) -> None:
        change = self.change
        out = data if change is None else change(deserialize_message(data, self.kind))
        if out is not None:
            self.passed += 1
            self.publisher.publish(out)


class Graph:
    """All nodes, started by the launch runner. As a context manager it leaves none of them behind.

    Attributes:
        watch: What they tell.
        nodes: Process id of each, by name.
        ended: (name, exit code) of those that ended.
        relays: By topic.
    """

    def __init__(
        self,
        log: Path,
        *,
        rate: float = 40.0,
        given: Mapping[str, str] | None = None,
        through: Mapping[str, tuple[str, type]] | None = None,
        prefixes: Mapping[str, Sequence[str]] | None = None,
        parameters: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Prepare.

        Args:
            log: File for the nodes' output.
            rate: Balls a minute.
            given: Arguments of the launch file.
            through: Topics that are relayed: the process that publishes each, and its type.
            prefixes: What stands before the command of a process, by its name.
            parameters: name:=value for a process, by its name.
        """
        self._log, self._through = log, through or {}
        arguments = {"rate": str(rate), "seed": "0", "record": "true", **(given or {})}
        self._processes = []
        for process in launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), arguments):
            remaps = [w for topic, (name, _) in self._through.items() if name == process.name for w in ("-r", f"{topic}:={THROUGH}{topic}")]
            sets = [w for value in (parameters or {}).get(process.name, ()) for w in ("-p", value)]
            # of remappings the first one that fits holds; of parameters the last one, if the first single one comes after the files
            at = process.command.index("--ros-args") + 1
            command = (*process.command[:at], *remaps, *process.command[at:], *sets)
            self._processes.append(replace(process, command=(*(prefixes or {}).get(process.name, ()), *command)))
        self.nodes: dict[str, int] = {}
        self.ended: list[tuple[str, int]] = []
        self.relays: dict[str, Relay] = {}

    def __enter__(self) -> Graph:
        if not rclpy.ok():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            for number in (signal.SIGINT, signal.SIGTERM):  # both leave nothing behind
                signal.signal(number, signal.default_int_handler)
        joints = "/joint_states"
        self._file = self._log.open("a", buffering=1)
        self.watch = Watch(THROUGH + joints if joints in self._through else joints, self._tell)
        self.relays = {topic: Relay(self.watch, topic, kind) for topic, (_, kind) in self._through.items()}
        self._over, executor = Future(), EventsExecutor()
        executor.add_node(self.watch)
        self._thread = threading.Thread(target=self._spin, args=(executor,), daemon=True)
        self._thread.start()
        self.system = launch.System(self._processes, self._tell)
        self.system.__enter__()
        if not self.until(lambda: any(ball.hit for ball in self.watch.balls), READY):
            self.__exit__()
            raise RuntimeError(f"no ball was hit within {READY:g} s; see {self._log}")
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self.nodes.values():
            send(pid, signal.SIGCONT)
        self.system.stop()
        self._over.set_result(None)
        self._thread.join(timeout=5.0)
        self.watch.destroy_node()
        self._file.close()
        shutil.rmtree("bags", ignore_errors=True)

    def _spin(self, executor: EventsExecutor) -> None:
        set_thread_realtime(CONTROL.realtime)  # what is relayed would come late on a busy machine, and the arm would brake
        try:
            while not self._over.done():
                executor.spin_until_future_complete(self._over, 3600.0)
        except ExternalShutdownException:
            pass

    def _tell(self, line: str) -> None:
        self._file.write(f"{time.time():.3f} {line}\n")
        if started := re.match(r"\[launch\] (\S+) started, process (\d+)", line):
            self.nodes[started[1]] = int(started[2])
        elif ended := re.match(r"\[launch\] (\S+) ended, exit code (-?\d+)", line):
            self.ended.append((ended[1], int(ended[2])))
            self.nodes.pop(ended[1], None)

    def until(self, condition: Callable[[], bool], bound: float) -> bool:
        """Wait until the condition holds, which is looked at whenever a phase changes or a node tells something.

        Args:
            condition: What is waited for.
            bound: s.

        Returns:
            Whether it came to hold within `bound`.
        """
        end = time.monotonic() + bound
        while not condition():
            if time.monotonic() > end:
                return False
            self.system.wait(0.0)
            with self.watch.changed:
                if not condition():
                    self.watch.changed.wait(0.02)
        return True

    def pause(self, duration: float) -> None:
        """Let the nodes run for `duration` (s)."""
        self.until(lambda: False, duration)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to the process of a node."""
        send(self.nodes.get(name), number)

    def freeze(self, name: str, duration: float) -> None:
        """Stop a node's process for `duration` (s)."""
        self.signal(name, signal.SIGSTOP)
        try:
            self.pause(duration)
        finally:
            self.signal(name, signal.SIGCONT)

    def enable(self) -> bool:
        """Call /arm/enable, as the person beside the robot does, until it answers; a node that was killed is known for seconds yet."""
        end = time.monotonic() + RECOVERY
        while time.monotonic() < end:
            if self.until(self.watch.enabler.service_is_ready, 2.0):
                answer = self.watch.enabler.call_async(SetBool.Request(data=True))
                if self.until(answer.done, 2.0):
                    return bool(answer.result().success)
                self.watch.enabler.remove_pending_request(answer)
        return False


def send(pid: int | None, number: signal.Signals) -> None:
    """Send a signal to a process that may have ended."""
    if pid is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
