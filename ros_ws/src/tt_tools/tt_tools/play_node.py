"""Play a bag: publish its messages byte for byte as they were recorded, after the subscribers that playback waits for have come."""

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
from tt_core.ros.bags import TYPESTORE, Bag, BagError
from tt_core.ros.discovery import RECORDERS, listeners
from tt_core.ros.params import declare
from tt_core.shared_memory import IMAGE_SEGMENT, set_segment

from .graph import Discovery
from .keys import HELP, attached, keyboard, read_key
from .packages import NotFound, interface
from .play import Playback, PlaybackItem, with_clock

QUEUE_DEPTH = 1000  # messages that a slow subscriber may be behind
SUBSCRIBER_CHECK_INTERVAL = 0.05  # s between two checks for subscribers
DISCOVERY_TIME = 1.0  # s from when nothing is missing to the begin of playback that waits; running nodes are usually discovered within it
CONNECTION = 3.0  # s, longest wait for nodes that run already to connect
STANDING = 0.05  # s between two messages on /clock while playback is paused
SEEK_STEP, RATE_STEP = 10**9, 1.1  # what one key changes: the position by ns, the rate by a factor
ACKNOWLEDGEMENT_TIMEOUT = 2.0  # s, longest wait at the end for acknowledgements
SLICE = 0.05  # s, part of this wait, after which an interrupt is handled


@dataclass(frozen=True)
class BagPlayParams:
    """Parameters of the player: what it plays, and how."""

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
        """Return whether a topic passes `regex` and `exclude`. Raises TtError if one of them is no valid regular expression."""
        try:
            return bool(re.search(self.regex, topic)) and not (self.exclude and re.search(self.exclude, topic))
        except re.error as error:
            raise TtError(f"{error.pattern!r} is no regular expression: {error}") from error


class Interrupts:
    """Lets the main thread sleep until another thread, a key or a signal (SIGINT or SIGTERM) interrupts it.

    A signal raises KeyboardInterrupt in `sleep` only, and so never inside a call of the middleware.
    """

    def __init__(self) -> None:
        """Take over SIGINT and SIGTERM. To be called by the main thread."""
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
        """Sleep until `seconds` have passed, another thread calls `wake`, or a key is pressed.

        Args:
            seconds: Longest sleep, s.
            keyboard: File descriptor of the terminal; None to ignore keys.

        Returns:
            Whether a key waits to be read.

        Raises:
            KeyboardInterrupt: SIGINT or SIGTERM arrived during the sleep or before it.
        """
        watched = [self._read, self._woken] + ([] if keyboard is None else [keyboard])
        ready = select.select(watched, [], [], max(0.0, seconds))[0]
        if self._read in ready:
            raise KeyboardInterrupt
        if self._woken in ready:
            os.read(self._woken, 4096)
        return keyboard in ready

    def wake(self) -> None:
        """End the present sleep of the main thread, or its next one if it is awake. Any thread may call this."""
        with suppress(BlockingIOError):  # the pipe is full, so the sleep ends anyway
            os.write(self._wake, b"x")

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let signals raise KeyboardInterrupt at once within this context, which must not call the middleware."""
        self._handle(signal.default_int_handler)
        try:
            self.sleep(0.0)
            yield
        finally:
            self._handle(lambda *_: None)


def offering_qos(recorded: Collection[Qos]) -> QoSProfile:
    """Return the profile of a publisher that can serve every subscriber which the recorded publishers could serve.

    It is reliable or transient local if one of the recorded publishers was, and reliable if none is known.
    """
    reliable = not recorded or any(qos.reliability is QosReliability.RELIABLE for qos in recorded)
    durable = any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in recorded)
    return QoSProfile(
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


class PlayNode(Node):
    """Node that publishes the topics of a bag and, if the parameter `clock` is set, /clock with the recorded time.

    Services: ~/pause (SetBool) pauses or resumes playback; ~/step (Trigger) plays one message while playback is paused. The parameters
    `rate` and `position` can be set while it plays.
    """

    def __init__(self, interrupts: Interrupts, params: BagPlayParams | None = None) -> None:
        """Declare the parameters and make the services.

        Args:
            interrupts: Wakes the main thread when a service was called or a parameter was set.
            params: Defaults of the node's parameters; those of BagPlayParams if None.
        """
        super().__init__("player", enable_rosout=False)
        self._interrupts, self._playback = interrupts, Playback(0, 1.0, 0.0)
        self.params = declare(self, params or BagPlayParams, changed=self._on_params)
        self.params.wants("")
        self.add_post_set_parameters_callback(self._on_set)
        self._outputs: dict[tuple[str, str], Publisher] = {}
        self._ticks = self.create_publisher(Clock, "/clock", 10) if self.params.clock else None
        self._start = self._stop = 0  # ns, of the bag
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)

    def _on_params(self, params: BagPlayParams) -> None:
        """Keep the new parameters."""
        self.params = params

    def _on_set(self, parameters: list[Parameter]) -> None:
        """Apply the parameters that act while the node runs. Setting `position` to the same value again moves playback again."""
        for parameter in parameters:
            if parameter.name == "rate":
                self._playback.set_rate(parameter.value, time.monotonic())
            elif parameter.name == "position":
                self._playback.seek(self._start + round(parameter.value * 1e9), time.monotonic())
        self._interrupts.wake()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Pause or resume playback: the service ~/pause."""
        self._playback.pause(request.data, time.monotonic())
        self._interrupts.wake()
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Play one message while playback is paused: the service ~/step."""
        response.success = self._playback.play_next()
        response.message = "one message" if response.success else "refused: playback is not paused"
        self._interrupts.wake()
        return response

    def _on_key(self, key: str | None) -> None:
        """Do what a key asks for; see keys.HELP."""
        now = time.monotonic()
        if key == "space":
            self._playback.pause(not self._playback.paused, now)
        elif key == "right":
            self._playback.play_next()
        elif key == "left":
            self._playback.seek(max(self._start, self._playback.position(now) - SEEK_STEP), now)
        elif key in ("up", "down"):
            self._playback.set_rate(self._playback.rate * (RATE_STEP if key == "up" else 1.0 / RATE_STEP), now)

    def offer(self, bag: Bag, remap: Mapping[str, str]) -> None:
        """Make a publisher for each topic of a bag that is to be played. A topic that cannot be played is left out with a warning.

        Args:
            bag: The bag that will be played.
            remap: New names of topics, by their recorded names.

        Raises:
            BagError: No topic can be played, and no clock is to be published.
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
        """Wait for subscribers, and publish the time of the start on /clock meanwhile.

        With the parameter `wait_for` or `recorded`, wait for the subscribers that it asks for, at most `patience` s. Without both, wait
        until the nodes that run already are discovered and connected.

        Args:
            start: Time in the recording that is published on /clock, ns.

        Raises:
            TtError: Not all subscribers came within `patience`.
            KeyboardInterrupt: SIGINT or SIGTERM arrived.
        """
        patient = bool(self.params.wait_for or self.params.recorded)
        begin = time.monotonic()
        since: float | None = None  # s, from when on nothing is missing; None while something is
        discovery = Discovery(self)
        while since is None or time.monotonic() < since + (DISCOVERY_TIME if patient else 0.0):
            self._tick(start)
            self._interrupts.sleep(SUBSCRIBER_CHECK_INTERVAL)
            known, waited = discovery.is_complete(), time.monotonic() - begin
            missing = self._missing() if patient else self._unconnected()
            since = None if missing or not known else since or time.monotonic()
            if patient and missing and waited > self.params.patience:
                raise TtError(f"nobody listens to {', '.join(missing)} within {self.params.patience:g} s")
            if not patient and known and waited > CONNECTION:
                return

    def _unconnected(self) -> list[str]:
        """Return the topics that have discovered subscribers, none of which has connected to our publisher yet."""
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
        """Publish the messages of a bag at their recorded times, as the parameters tell.

        Args:
            bag: The bag to play.
            keyboard: File descriptor of the terminal whose keys control playback; None without one.

        Returns:
            Number of messages that were published.

        Raises:
            KeyboardInterrupt: SIGINT or SIGTERM arrived.
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
        end = time.monotonic() + ACKNOWLEDGEMENT_TIMEOUT
        for output in self._outputs.values():
            while not output.wait_for_all_acked(Duration(seconds=SLICE)) and time.monotonic() < end:
                self._interrupts.sleep(0.0)
        self._interrupts.sleep(params.linger)
        return count

    def _steps(self, bag: Bag, start: int) -> Iterator[PlaybackItem]:
        """Return the messages and clock ticks to be played from `start` (ns of the recording) on."""
        topics = {name for name, _ in self._outputs} or {""}
        steps: Iterator[PlaybackItem] = (PlaybackItem(m.time, (m.topic, m.kind), m.data) for m in bag.messages(topics, start, self._stop))
        if self._ticks is None:
            return steps
        return with_clock(steps, start, self._stop, round(self._playback.rate / self.params.clock * 1e9))

    def _sleep_until(self, step: PlaybackItem, moves: int, keyboard: int | None) -> bool:
        """Sleep until a step is due. Return False if playback was moved to another position meanwhile."""
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
    return kind in TYPESTORE.types


def play_bag(params: BagPlayParams | None = None, remap: Mapping[str, str] | None = None, *, keys: bool = False) -> int:
    """Play a bag to its end.

    Args:
        params: What is played, and how; None to use the ROS parameters of the command line.
        remap: New names of topics, by their recorded names; None for none.
        keys: Whether keys of the terminal control playback, if there is a terminal.

    Returns:
        Number of messages that were published.

    Raises:
        TtError: The bag cannot be read, or not all subscribers came that playback waits for.
        KeyboardInterrupt: SIGINT or SIGTERM arrived.
    """
    interrupts = Interrupts()
    set_segment(IMAGE_SEGMENT)
    try:
        rclpy.init(args=[] if params else None, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # RCLError: the ROS arguments are not valid
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
    """Answer services and parameter requests until rclpy is shut down. Runs in a thread of its own."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        executor.spin()


def main() -> int:
    """Play the bag that the ROS parameters of the command line name, and return the exit code."""
    try:
        print(f"played {play_bag()} messages", flush=True)
    except TtError as error:
        print(f"play: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
