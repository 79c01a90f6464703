"""Publishes a recording byte for byte, after the subscribers that it waits for have come."""

from __future__ import annotations

import os
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Qos, QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.ros.bags import TYPES, Bag, BagError
from tt_core.ros.discovery import RECORDERS, listeners
from tt_core.ros.params import declare

from .graph import Discovery
from .keys import HELP, attached, keyboard, read_key
from .packages import NotFound, interface
from .play import Playback, PlaybackItem, with_clock

DEPTH = 1000  # messages that a slow subscriber may be behind
POLL = 0.05  # s between two looks for subscribers
SETTLED = 1.0  # s, within which running nodes are usually discovered: playback that waits begins when no other one has come for so long
CONNECTION = 3.0  # s, at most, for the nodes that are there to connect
STANDING = 0.05  # s between two ticks of a clock that stands still
BACK, FASTER = 10**9, 1.1  # ns and factor of the rate, of one key
ACKNOWLEDGED, SLICE = 2.0, 0.05  # s at the end for reliable subscribers, in slices between which an interrupt is seen


@dataclass(frozen=True)
class PlayParams:
    """What is played and how."""

    bag: str = param("", "", "path of a bag of any kind")
    rate: float = param(1.0, "", "recorded seconds in a second", low=1e-3, high=1e3, dynamic=True)
    clock: float = param(0.0, "Hz", "rate of /clock with the recorded time; 0 for none", low=0.0, high=1e4)
    topics: tuple[str, ...] = param((), "", "topics to play; all if empty")
    regex: str = param("", "", "regular expression; only topics in which it is found are played")
    exclude: str = param("", "", "regular expression; topics in which it is found are not played")
    position: float = param(
        0.0,
        "s",
        "time after the first message at which playback begins; it goes on there when it is set",
        low=0.0,
        high=1e9,
        dynamic=True,
    )
    duration: float = param(0.0, "s", "recorded time that is played; 0: to the end", low=0.0, high=1e9)
    loop: bool = param(False, "", "whether playback begins again at the end")
    paused: bool = param(False, "", "whether playback begins paused; see the services ~/pause and ~/step")
    delay: float = param(0.0, "s", "time to wait before anything else", low=0.0, high=1e6)
    wait_for: tuple[str, ...] = param((), "", "topics, played or not, each of which must have a subscriber before playback begins")
    recorded: bool = param(False, "", "whether playback also waits until a recorder subscribes to all topics that are published")
    patience: float = param(120.0, "s", "longest wait for the subscribers that playback waits for", low=0.0, high=1e6)
    linger: float = param(0.0, "s", "time to stay after the last message, so that subscribers can finish", low=0.0, high=1e6)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    def wants(self, topic: str) -> bool:
        """Tell whether a topic passes the regular expressions. Raises TtError for one that is none."""
        try:
            return bool(re.search(self.regex, topic)) and not (self.exclude and re.search(self.exclude, topic))
        except re.error as error:
            raise TtError(f"{error.pattern!r} is no regular expression: {error}") from error


class Interrupts:
    """Ends the sleep of the main thread: by other threads, by keys, and by SIGINT and SIGTERM, which never end it in the middleware."""

    def __init__(self) -> None:
        self._read, write = os.pipe()
        self._woken, self._wake = os.pipe()
        for descriptor in (write, self._woken, self._wake):
            os.set_blocking(descriptor, False)
        signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        self._handle(lambda *_: None)

    @staticmethod
    def _handle(handler: object) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, handler)  # type: ignore[arg-type]

    def sleep(self, seconds: float, keyboard: int | None = None) -> bool:
        """Sleep for `seconds`, or until another thread calls `wake` or a key is pressed.

        Args:
            seconds: s.
            keyboard: File descriptor of the terminal, None to ignore keys.

        Returns:
            Whether a key waits to be read.

        Raises:
            KeyboardInterrupt: A signal came, now or before.
        """
        watched = [self._read, self._woken] + ([] if keyboard is None else [keyboard])
        ready = select.select(watched, [], [], max(0.0, seconds))[0]
        if self._read in ready:
            raise KeyboardInterrupt
        if self._woken in ready:
            os.read(self._woken, 4096)
        return keyboard in ready

    def wake(self) -> None:
        """End the present sleep, or the next one. Any thread may call it."""
        with suppress(BlockingIOError):  # it is full, so the sleep ends anyway
            os.write(self._wake, b"x")

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a signal interrupt whatever is done in this context; it must not be the middleware."""
        self._handle(signal.default_int_handler)
        try:
            self.sleep(0.0)
            yield
        finally:
            self._handle(lambda *_: None)


def offering_qos(recorded: Collection[Qos]) -> QoSProfile:
    """Return the profile that serves every subscriber which the recorded publishers could serve."""
    reliable = not recorded or any(qos.reliability is QosReliability.RELIABLE for qos in recorded)
    durable = any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in recorded)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


class PlayNode(Node):
    """Publishes the topics of a bag, and /clock with the recorded time.

    Services: ~/pause (SetBool) stops recorded time or lets it pass, ~/step (Trigger) plays one message while it is stopped. The parameters
    `rate` and `position` act while it plays.
    """

    def __init__(self, interrupts: Interrupts, params: PlayParams | None = None) -> None:
        """Make the node.

        Args:
            interrupts: Ends the sleep of the main thread when something is to be done.
            params: What is played and how, unless the node's parameters say otherwise; the defaults if None.
        """
        super().__init__("player", enable_rosout=False)
        self._interrupts, self._playback = interrupts, Playback(0, 1.0, 0.0)
        self.params = declare(self, params or PlayParams, changed=self._on_params)
        self.params.wants("")
        self.add_post_set_parameters_callback(self._on_set)
        self._outputs: dict[tuple[str, str], Publisher] = {}
        self._ticks = self.create_publisher(Clock, "/clock", 10) if self.params.clock else None
        self._start = self._stop = 0  # ns, of the bag
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)

    def _on_params(self, params: PlayParams) -> None:
        """Keep what was set."""
        self.params = params

    def _on_set(self, parameters: list[Parameter]) -> None:
        """Apply what acts at run time. A `position` that is set again acts again."""
        for parameter in parameters:
            if parameter.name == "rate":
                self._playback.set_rate(parameter.value, time.monotonic())
            elif parameter.name == "position":
                self._playback.seek(self._start + round(parameter.value * 1e9), time.monotonic())
        self._interrupts.wake()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stop recorded time, or let it pass, the service ~/pause."""
        self._playback.pause(request.data, time.monotonic())
        self._interrupts.wake()
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Play one message while recorded time stands still, the service ~/step."""
        response.success = self._playback.play_next()
        response.message = "one message" if response.success else "refused: playback is not paused"
        self._interrupts.wake()
        return response

    def _on_key(self, key: str | None) -> None:
        """Do what a key stands for."""
        now = time.monotonic()
        if key == "space":
            self._playback.pause(not self._playback.paused, now)
        elif key == "right":
            self._playback.play_next()
        elif key == "left":
            self._playback.seek(max(self._start, self._playback.position(now) - BACK), now)
        elif key in ("up", "down"):
            self._playback.set_rate(self._playback.rate * (FASTER if key == "up" else 1.0 / FASTER), now)

    def offer(self, bag: Bag, remap: Mapping[str, str]) -> None:
        """Make the publishers. Topics that cannot be played are left out, by name.

        Args:
            bag: What is played.
            remap: New names by old ones.
        """
        wanted = [expand_topic_name(name, self.get_name(), self.get_namespace()) for name in self.params.topics]
        for topic in bag.topics:
            if (wanted and topic.name not in wanted) or (self._ticks and topic.name == "/clock") or not self.params.wants(topic.name):
                continue
            try:
                kind = interface(topic.kind)
            except NotFound as error:
                self.get_logger().warning(f"{topic.name} is left out: {topic.refusal or error}")
                continue
            if topic.refusal:
                self.get_logger().warning(f"{topic.name} is left out: {topic.refusal}")
                continue
            output = self.create_publisher(kind, remap.get(topic.name, topic.name), offering_qos(topic.offered))
            self._outputs[topic.name, topic.kind] = output
        if missing := set(wanted) - {topic.name for topic in bag.topics}:
            self.get_logger().warning(f"not in the bag: {', '.join(sorted(missing))}")
        if not self._outputs and self._ticks is None:
            raise BagError(f"{bag.path} has nothing to play; its topics are {', '.join(topic.name for topic in bag.topics)}")

    def wait(self, start: int) -> None:
        """Wait for subscribers; meanwhile the clock stands at the start.

        Without `wait_for` and `recorded` it waits until the nodes that are there already are discovered and connected.

        Args:
            start: ns, time of the recording at which the clock stands.

        Raises:
            TtError: If not all came within `patience`.
            KeyboardInterrupt: If a signal came.
        """
        patient = bool(self.params.wait_for or self.params.recorded)
        begin = time.monotonic()
        since: float | None = None  # s, when the last one came
        discovery = Discovery(self)
        while since is None or time.monotonic() < since + (SETTLED if patient else 0.0):
            self._tick(start)
            self._interrupts.sleep(POLL)
            known, waited = discovery.is_complete(), time.monotonic() - begin
            missing = self._missing() if patient else self._unconnected()
            since = None if missing or not known else since or time.monotonic()
            if patient and missing and waited > self.params.patience:
                raise TtError(f"nobody listens to {', '.join(missing)} within {self.params.patience:g} s")
            if not patient and known and waited > CONNECTION:
                return

    def _unconnected(self) -> list[str]:
        """Return the topics whose subscribers are known and have not connected to this publisher."""
        outputs = [*self._outputs.values(), *([self._ticks] if self._ticks is not None else [])]
        return [output.topic_name for output in outputs if not output.get_subscription_count() and listeners(self, output.topic_name)]

    def _unmatched(self) -> list[str]:
        return [output.topic_name for output in self._outputs.values() if not output.get_subscription_count()]

    def _missing(self) -> list[str]:
        """Return the topics whose subscribers playback still waits for."""
        ours = set(self._unmatched())
        wanted = [self.resolve_topic_name(name) for name in self.params.wait_for]
        missing = [name for name in wanted if name in ours or not listeners(self, name) - RECORDERS]
        if self.params.recorded:
            for name, kinds in self.get_topic_names_and_types():
                if self.count_publishers(name) and _can_be_recorded(kinds[0]) and not listeners(self, name) & RECORDERS:
                    missing.append(f"{name} (to record it)")
        return missing

    def play(self, bag: Bag, keyboard: int | None) -> int:
        """Publish all messages.

        Args:
            bag: What is played.
            keyboard: File descriptor of the terminal, None without one.

        Returns:
            How many messages were published.

        Raises:
            KeyboardInterrupt: If a signal came.
        """
        params = self.params
        first = bag.start + round(params.position * 1e9)
        self._start, self._stop = bag.start, min(bag.end, first + round(params.duration * 1e9)) if params.duration else bag.end
        self._playback = Playback(first, params.rate, time.monotonic(), paused=params.paused or self._playback.paused)
        count = 0
        while True:
            moves = self._playback.moves
            for step in self._steps(bag, self._playback.origin):
                if not self._sleep_until(step, moves, keyboard):
                    break
                if step.topic is None:
                    self._tick(step.time)
                elif output := self._outputs.get(step.topic):
                    output.publish(step.data)
                    count += 1
                self._playback.done(step)
            else:
                if not params.loop:
                    break
                self._playback.seek(first, time.monotonic())
        end = time.monotonic() + ACKNOWLEDGED
        for output in self._outputs.values():
            while not output.wait_for_all_acked(Duration(seconds=SLICE)) and time.monotonic() < end:
                self._interrupts.sleep(0.0)
        self._interrupts.sleep(params.linger)
        return count

    def _steps(self, bag: Bag, start: int) -> Iterator[PlaybackItem]:
        """Return what is played from `start`, ns, on."""
        topics = {name for name, _ in self._outputs} or {""}
        steps: Iterator[PlaybackItem] = (PlaybackItem(m.time, (m.topic, m.kind), m.data) for m in bag.messages(topics, start, self._stop))
        if self._ticks is None:
            return steps
        return with_clock(steps, start, self._stop, round(self._playback.rate / self.params.clock * 1e9))

    def _sleep_until(self, step: PlaybackItem, moves: int, keyboard: int | None) -> bool:
        """Sleep until a step is due. Return False if playback was moved to another place meanwhile."""
        while self._playback.moves == moves:
            now = time.monotonic()
            seconds = self._playback.wait(step, now)
            if self._interrupts.sleep(min(seconds, STANDING), keyboard) and keyboard is not None:
                self._on_key(read_key(keyboard))
            elif seconds <= STANDING and self._playback.wait(step, time.monotonic()) <= 0.0:
                return self._playback.moves == moves
            elif self._playback.paused:
                self._tick(self._playback.position(now))
        return False

    def _tick(self, time: int) -> None:
        if self._ticks is not None:
            self._ticks.publish(Clock(clock=Time(sec=time // 10**9, nanosec=time % 10**9)))


def _can_be_recorded(kind: str) -> bool:
    try:
        interface(kind)
    except NotFound:
        return False
    return kind in TYPES.types


def play(params: PlayParams | None = None, remap: Mapping[str, str] | None = None, *, keys: bool = False) -> int:
    """Play a bag to its end.

    Args:
        params: What is played and how; by the ROS parameters of the command line if None.
        remap: New names by old ones.
        keys: Whether keys of the terminal act, if there is one.

    Returns:
        How many messages were published.

    Raises:
        TtError: If the bag cannot be read, or not all subscribers came that playback waits for.
        KeyboardInterrupt: If SIGINT or SIGTERM came.
    """
    interrupts = Interrupts()
    try:
        rclpy.init(args=[] if params else None, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # RCLError: arguments of ROS that are none
        raise TtError(str(error).partition(", at /")[0]) from error
    node, thread = None, None
    try:
        node = PlayNode(interrupts, params)
        path = Path(node.params.bag)
        with interrupts.at_once():
            bag = Bag(path)
        with bag, ExitStack() as stack:
            if not bag.count:
                raise BagError(f"{path} holds no messages")
            node.offer(bag, remap or {})
            thread = threading.Thread(target=_serve, args=(node,), daemon=True)
            thread.start()
            interrupts.sleep(node.params.delay)
            node.wait(bag.start + round(node.params.position * 1e9))
            print(f"playing {path}" + (f"; {HELP}" if keys and attached() else ""), flush=True)
            terminal = stack.enter_context(keyboard()) if keys and attached() else None
            return node.play(bag, terminal)
    finally:
        rclpy.try_shutdown()
        if thread is not None:
            thread.join()
        if node is not None:
            node.destroy_node()


def _serve(node: Node) -> None:
    """Answer services and parameters until the end of the context."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        executor.spin()


def main() -> int:
    """Play by the ROS parameters of the command line."""
    try:
        print(f"played {play()} messages", flush=True)
    except TtError as error:
        print(f"play: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
