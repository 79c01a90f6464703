"""Faults of every kind into the running graph, and what becomes of arm and play. scripts/bench faults

Survived is a fault after which no bound of the true arm was broken, no node ended but those that the fault killed, and a ball launched
after it was hit within 30 s without a person's help; only when arm_node itself was killed a person enables it again.

--only NAME: faults whose name holds NAME. --quick: one of each kind, three minutes.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from broken import broken, kinds
from graph import NODES, PHASES, RECOVERY, Graph
from rclpy.qos import DurabilityPolicy, QoSProfile
from report import report
from rich.console import Console
from rich.table import Table
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import TimeReference
from std_msgs.msg import Float64MultiArray, String
from tt_arm.model import ArmModel
from tt_bringup.demo import free_domain
from tt_core.learnt_physics import physics_to_text
from tt_core.physics import Physics
from tt_core.ros.convert import (
    ball_to_message,
    camera_to_message,
    goal_to_message,
    image_to_message,
    joints_to_message,
    path_to_message,
    stamp,
    strokes_to_message,
)
from tt_core.states import BallPath, BallState, RacketState, ReturnGoal
from tt_vision.rig import high_speed_pair

FREEZES = (0.05, 0.3, 2.0)  # s
LONG = 2.0  # s, for which broken messages come
RATE = 50.0  # 1/s, of broken messages; those of more than LARGE bytes come twice a second
LARGE = 100_000
PHASE = 15.0  # s, within which a phase of the rally comes
OWN = "TT_FAULTS_OWN_MEMORY"  # set where /dev/shm is this benchmark's own
SHARED = Path("/dev/shm")


def good_messages() -> dict[str, tuple[Any, str | None]]:
    """One good message for each topic that a node subscribes to, and the process that publishes it, None where no relay is wanted."""
    arm, now = ArmModel.pa10(), time.time()
    ball = BallState(now, [2.4, 0.76, 0.4], [-5.0, 0.0, 1.0], [0.0, -300.0, 0.0], 1e-6 * np.eye(9))
    times = now + 0.02 * np.arange(30)
    flight = np.outer(times - now, ball.velocity) + ball.position
    path = BallPath(times, flight, np.tile(ball.velocity, (30, 1)), np.tile(ball.spin, (30, 1)), ())
    racket = RacketState.facing(now + 0.4, [-0.2, 0.76, 0.2], [1.0, 0.0, 0.2], [1.0, 0.0, 0.0])
    cameras = dict(zip(("left", "right"), high_speed_pair(), strict=True))
    found: dict[str, tuple[Any, str | None]] = {}
    for name, camera in cameras.items():
        image = np.full((camera.height, camera.width), 8, np.uint8)
        found[f"/camera/{name}/image_raw"] = image_to_message(image, now, f"{name}_optical"), None
        info = camera_to_message(camera.width, camera.height, camera.matrix, camera.distortion, f"{name}_optical", now)
        found[f"/camera/{name}/camera_info"] = info, None
    ping, pong = TimeReference(source="estimate"), TimeReference(source="sim", time_ref=stamp(now))
    ping.header.stamp, pong.header.stamp, pong.header.frame_id = stamp(now), stamp(now), "estimate"
    return {
        **found,
        "/ball/first": (ball_to_message(ball), "estimate"),
        "/ball/measured": (ball_to_message(ball), "estimate"),
        "/physics": (String(data=physics_to_text(Physics.liu(), "liu")), None),
        "/ball/path": (path_to_message(path), "predict"),
        "/return/goal": (goal_to_message(ReturnGoal([2.0, 0.76], 0.5, 0.0, 0.0), now), None),
        "/racket/strokes": (strokes_to_message([racket], now), "racket"),
        "/joint_states": (joints_to_message(arm.names, now, arm.waiting, np.zeros(7)), "sim"),
        "/arm_velocity_controller/commands": (Float64MultiArray(data=[0.1] * 7), "arm"),
        "/clock_offset/ping": (ping, None),
        "/clock_offset/pong": (pong, None),
        "/clock": (Clock(clock=stamp(now)), "sim"),
    }


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        name: What people read.
        inject: Begins and ends it; blocks in between.
        setting: The graph that it is for, one of SETTINGS.
        phases: Of the rally, in each of which it is injected.
        kills: The node that it ends, if any.
        stops: Whether the arm has to stop for it.
        quick: Whether it is one of the few of --quick.
    """

    name: str
    inject: Callable[[Graph], None]
    setting: str = "plain"
    phases: tuple[str, ...] = ("swing",)
    kills: str | None = None
    stops: bool = False
    quick: bool = False


class NotInjected(Exception):
    """The fault has not reached the graph."""


@dataclass
class Result:
    """times: how often it was injected. failures: why it was not survived. reactions: ms."""

    fault: Fault
    times: int = 0
    failures: list[str] = field(default_factory=list)
    reactions: list[float] = field(default_factory=list)


def second_publisher(topic: str, good: Any, name: str) -> Callable[[Graph], None]:
    """Another node publishes broken messages on the topic, beside the real publisher."""

    def inject(graph: Graph) -> None:
        make = kinds(good)[name]
        large = name == "oversize"
        ready = broken(make, good, time.time()) if large else None
        intruder = rclpy.create_node("intruder", enable_rosout=False, start_parameter_services=False)
        try:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # what every subscription can be served with
            publisher, end = intruder.create_publisher(type(good), topic, qos), time.monotonic() + LONG
            while time.monotonic() < end:
                publisher.publish(ready if large else broken(make, good, time.time()))
                graph.pause(0.5 if large else 1.0 / RATE)
            if not publisher.get_subscription_count():
                raise NotInjected(f"no one listens to {topic}")
        finally:
            intruder.destroy_node()

    return inject


def sole_publisher(topic: str, good: Any, name: str) -> Callable[[Graph], None]:
    """What the real publisher sends arrives broken."""

    def inject(graph: Graph) -> None:
        make, relay, last = kinds(good)[name], graph.relays[topic], [0.0]
        ready = broken(make, good, time.time()) if name == "oversize" else None  # takes a second
        relay.passed = 0

        def change(message: Any) -> Any:
            if name == "oversize":
                if time.monotonic() - last[0] < 0.5:
                    return None
                last[0] = time.monotonic()
                return ready
            return make(message, time.time())

        relay.change = change
        try:
            graph.pause(LONG)
        finally:
            relay.change = None
        if not relay.passed:
            raise NotInjected(f"nothing came on {topic}")

    return inject


def silence(topic: str) -> Callable[[Graph], None]:
    """Nothing arrives from the real publisher."""

    def inject(graph: Graph) -> None:
        graph.relays[topic].change = lambda _: None
        try:
            graph.pause(LONG)
        finally:
            graph.relays[topic].change = None

    return inject


def busy(graph: Graph) -> None:
    """A process for each core that does nothing else than compute."""
    loads = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(os.cpu_count() or 2)]
    try:
        graph.pause(8.0)
    finally:
        for load in loads:
            load.kill()
            load.wait()


def fill_memory(graph: Graph) -> Iterator[None]:
    """Fill this benchmark's own /dev/shm to the last byte."""
    file = SHARED / "filler"
    try:
        with contextlib.suppress(OSError), file.open("wb", buffering=0) as out:
            while True:
                out.write(bytes(2**20))
        yield
    finally:
        file.unlink(missing_ok=True)


def memory_full(graph: Graph) -> None:
    for _ in fill_memory(graph):
        graph.pause(5.0)


def killed_while_memory_full(graph: Graph) -> None:
    for _ in fill_memory(graph):
        graph.signal("predict", signal.SIGKILL)
        graph.pause(8.0)


def all_faults() -> list[Fault]:
    """The table."""
    faults = [
        Fault(
            f"{node} killed",
            lambda g, n=node: g.signal(n, signal.SIGKILL),
            phases=PHASES,
            kills=node,
            stops=node == "arm",
            quick=node == "racket",
        )  # type: ignore[misc]
        for node in NODES
    ]
    faults += [
        Fault(
            f"{node} frozen for {s:g} s",
            lambda g, n=node, s=s: g.freeze(n, s),
            phases=PHASES,
            stops=node == "arm" and s > 0.1,
            quick=(node, s) in (("arm", 0.3), ("estimate", 0.3), ("sim", 0.3)),
        )  # type: ignore[misc]
        for node in NODES
        for s in FREEZES
    ]
    some = {
        ("/joint_states", "1e17"),
        ("/racket/strokes", "oversize"),
        ("/camera/left/image_raw", "too short"),
        ("/ball/measured", "NaN"),
        ("/arm_velocity_controller/commands", "NaN"),
    }
    for topic, (good, publisher) in good_messages().items():
        stops, setting = topic in ("/joint_states", "/arm_velocity_controller/commands"), "clock" if topic == "/clock" else "plain"
        for kind in kinds(good):
            faults.append(
                Fault(f"{topic} also with {kind}", second_publisher(topic, good, kind), setting, stops=stops, quick=(topic, kind) in some)
            )
        if publisher is None:
            continue
        setting, stops = "clock" if topic == "/clock" else "relayed", stops or topic == "/clock"
        for kind in kinds(good):
            lie = stops and kind == "names and values reversed"
            faults.append(
                Fault(
                    f"{topic} only with {kind}",
                    sole_publisher(topic, good, kind),
                    setting,
                    stops=stops and not lie,
                    quick=(topic, kind) in some,
                )
            )
        faults.append(Fault(f"{topic} silent", silence(topic), setting, stops=stops, quick=topic == "/clock"))
    faults.append(Fault("all cores busy", busy, quick=True))
    faults.append(Fault("disk full", lambda g: g.pause(10.0), "disk full", quick=True))
    faults.append(Fault("disk slow", lambda g: g.pause(10.0), "disk slow"))
    faults.append(Fault("shared memory full", memory_full, "own memory", quick=True))
    faults.append(Fault("predict killed, shared memory full", killed_while_memory_full, "own memory", kills="predict"))
    return faults


def settings(log: Path) -> dict[str, Callable[[], Graph] | str]:
    """How the graph of each setting is made, or why it cannot be here."""
    good = good_messages()
    relayed = {topic: (publisher, type(m)) for topic, (m, publisher) in good.items() if publisher and topic != "/clock"}
    clock = {"/clock": ("sim", Clock)}
    own = OWN in os.environ
    # the recorder keeps 64 MB free: 30 MB take ten seconds
    tiny = ("unshare", "-m", "sh", "-c", 'mkdir -p bags && mount -t tmpfs -o size=96m tmpfs bags && exec "$@"', "sh")
    slow = ("strace", "-f", "-qq", "--seccomp-bpf", "-o", "/dev/null", "-e", "trace=write", "-e", "inject=write:delay_enter=50000")
    no_mount = "mounting is not permitted here"
    return {
        "plain": lambda: Graph(log),
        "relayed": lambda: Graph(log, through=relayed),
        "clock": lambda: Graph(log, through=clock, given={"use_sim_time": "true"}),
        "disk full": (lambda: Graph(log, prefixes={"record": tiny})) if own else no_mount,
        "disk slow": (lambda: Graph(log, prefixes={"record": slow})) if shutil.which("strace") else "there is no strace here",
        "own memory": (lambda: Graph(log)) if own else no_mount,
    }


def play(graph: Graph, fault: Fault, phase: str, result: Result) -> bool:
    """Inject a fault once; returns whether the graph can go on as it is."""
    result.times += 1
    watch, before = graph.watch, len(graph.ended)
    if not graph.until(lambda: watch.phase == phase, PHASE):
        result.failures.append(f"{phase}: the phase did not come{last_word(graph)}")
        return False
    began = time.time()
    try:
        fault.inject(graph)
    except NotInjected as error:
        result.failures.append(f"{phase}: not injected: {error}")
        return True
    over = time.time()
    if fault.kills == "arm" and not graph.enable():
        result.failures.append(f"{phase}: /arm/enable does not answer")
        return False
    hit = graph.until(lambda: watch.hit_since(over), RECOVERY)
    if fault.stops and (reaction := watch.reaction(began)) is not None:
        result.reactions.append(reaction)
    wrong = [f"{name} ended, {code}" for name, code in graph.ended[before:] if name in NODES and name != fault.kills]
    graph.until(lambda: set(NODES) <= graph.nodes.keys(), RECOVERY)  # a recorder is not needed for a hit
    if missing := sorted(set(NODES) - graph.nodes.keys()):
        wrong.append(f"not running: {', '.join(missing)}")
    if bound := watch.broken():
        wrong.append(bound)
    if not hit:
        wrong.append(f"no hit in {RECOVERY:g} s{last_word(graph)}")
    if wrong:
        result.failures.append(f"{phase}: {'; '.join(wrong)}")
    return hit and not missing and bound is None


def last_word(graph: Graph) -> str:
    """The newest warning of the arm."""
    last = next((w for w in reversed(graph.watch.warnings) if w.name.startswith("arm")), None)
    return f", last word of {last.name}: {last.text}" if last else ""


def uncovered(graph: Graph) -> set[str]:
    """Topics that a node subscribes to and for which there is no fault."""
    graph.until(lambda: set(NODES) <= set(graph.watch.get_node_names()), RECOVERY)
    found = {topic for name in NODES if name != "record" for topic, _ in graph.watch.get_subscriber_names_and_types_by_node(name, "/")}
    return found - good_messages().keys() - {"/parameter_events"}


def run(faults: Sequence[Fault], log: Path, report_result: Callable[[Result], None]) -> None:
    """Inject all, those of one setting into one graph as long as it lives. told: takes each result."""
    for setting, make in settings(log).items():
        wanted = [fault for fault in faults if fault.setting == setting]
        if isinstance(make, str):
            for fault in wanted:
                Console().print(f"left out: {fault.name}, {make}")
            continue
        with contextlib.ExitStack() as stack:
            graph: Graph | None = None
            is_unchecked = setting == "plain"  # whether the topics of the graph still have to be compared with the list of faults
            for fault in wanted:
                result = Result(fault)
                for phase in fault.phases:
                    try:
                        graph = graph or stack.enter_context(make())
                    except RuntimeError as error:
                        result.failures.append(str(error))
                        break
                    if is_unchecked and (missing := uncovered(graph)):
                        forgotten = Fault(f"topics {', '.join(sorted(missing))}", graph.pause)  # type: ignore[arg-type]
                        report_result(Result(forgotten, 1, ["a node subscribes, and no fault is injected"]))
                    is_unchecked = False
                    if not play(graph, fault, phase, result):
                        stack.close()
                        graph = None
                report_result(result)


def table(results: Sequence[Result]) -> Table:
    rows = Table("fault", "times", "survived", "slowest reaction (ms)", "note", title="faults")
    for r in results:
        slowest = f"{max(r.reactions):.0f}" if r.reactions else ""
        rows.add_row(r.fault.name, str(r.times), str(r.times - len(r.failures)), slowest, " | ".join(r.failures))
    return rows


def with_own_memory() -> None:
    """Start again where /dev/shm is ours alone, if that is permitted."""
    if OWN in os.environ or subprocess.run(["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", SHARED], capture_output=True).returncode:
        return
    os.environ[OWN] = "1"
    script = 'mount -t tmpfs -o size=512m tmpfs /dev/shm && exec "$@"'
    os.execvp("unshare", ["unshare", "-m", "sh", "-c", script, "sh", sys.executable, *sys.argv])


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/bench faults", description=__doc__)
    parser.add_argument("--json", type=Path, help="write the metrics here")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="faults whose name holds one of these")
    parser.add_argument("--quick", action="store_true", help="one of each kind")
    parser.add_argument("--log", type=Path, default=Path(tempfile.gettempdir()) / "faults.log", help="the nodes' output")
    args = parser.parse_args()
    with_own_memory()
    free_domain()
    random.seed(0)
    path, log = args.json and args.json.absolute(), args.log.absolute()
    log.unlink(missing_ok=True)
    faults = [f for f in all_faults() if not args.only or any(name in f.name for name in args.only)]
    if args.quick:
        faults = [replace(f, phases=("swing",)) for f in faults if f.quick]
    console, began = Console(width=200), time.monotonic()

    results: list[Result] = []

    def report_result(result: Result) -> None:
        results.append(result)
        console.print(
            f"{time.monotonic() - began:6.0f} s  {result.fault.name}: {'; '.join(result.failures) or 'survived'}", highlight=False
        )

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # recordings go here
        with contextlib.suppress(KeyboardInterrupt):  # what is known so far is told
            run(faults, log, report_result)
        os.chdir("/")
    console.print(table(results))
    times, failed = sum(r.times for r in results), sum(len(r.failures) for r in results)
    metrics = {"injected": float(times), "survived": float(times - failed), "minutes": (time.monotonic() - began) / 60.0}
    for r in results:
        metrics[f"{r.fault.name}: survived"] = float(r.times - len(r.failures))
        if r.reactions:
            metrics[f"{r.fault.name}: slowest_reaction_ms"] = max(r.reactions)
    report("faults", times, {name: metrics[name] for name in ("injected", "survived", "minutes")}, None)
    if path:
        report("faults", times, metrics, path)
    rclpy.try_shutdown()
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
