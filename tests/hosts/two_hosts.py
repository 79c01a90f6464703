"""Two machines on this one: network namespaces with a cable between them, and the robot started on them as the README shows.

A machine is a process in a network of its own and with a /dev/shm of its own; both are gone with the last process in them.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tt_core.ros.diagnostics import Event, ReceivedStatus

TOOLS = ("ip", "unshare", "nsenter", "mount", "setpriv")
CABLE = "cable"  # name of the interface on either machine
ADDRESSES = ("10.64.0.1", "10.64.0.2")
PATIENCE = 25.0  # s, for a launch to end its nodes by itself


class NotPossible(Exception):
    """This computer cannot make network namespaces; the message says why."""


@dataclass(frozen=True)
class Machine:
    """A network namespace, held open by the process `holder`."""

    address: str
    holder: int

    def inside(self, *words: str) -> list[str]:
        """Return the command that runs `words` on this machine, in the present directory."""
        return ["nsenter", "--net", "--mount", f"--wd={Path.cwd()}", "--target", str(self.holder), *words]

    def unplug(self) -> None:
        """Take the cable out."""
        _call(*self.inside("ip", "link", "set", CABLE, "down"))

    def plug(self) -> None:
        """Put the cable in."""
        _call(*self.inside("ip", "link", "set", CABLE, "up"))

    @contextmanager
    def slow(self, rate: str = "300kbit") -> Iterator[None]:
        """Let no more than `rate` out, with room for 5 s of it. Raises NotPossible without tc or its token bucket."""
        if shutil.which("tc") is None:
            raise NotPossible("no program tc")
        queue = "dev", CABLE, "root"
        _call(*self.inside("tc", "qdisc", "add", *queue, "tbf", "rate", rate, "burst", "5kb", "latency", "5s"))
        try:
            yield
        finally:
            _call(*self.inside("tc", "qdisc", "del", *queue))


def _call(*words: str) -> str:
    done = subprocess.run(words, capture_output=True, text=True, timeout=10.0, check=False)
    if done.returncode:
        raise NotPossible(f"{' '.join(words)}: {done.stderr.strip()}")
    return done.stdout


@contextmanager
def two_machines() -> Iterator[tuple[Machine, Machine]]:
    """Make two machines and the cable between them.

    Raises:
        NotPossible: a tool is missing, or this user may not make namespaces.
    """
    if missing := [tool for tool in TOOLS if shutil.which(tool) is None]:
        raise NotPossible(f"no program {', '.join(missing)}")
    with ExitStack() as stack:
        machines = [Machine(address, _holder(stack)) for address in ADDRESSES]
        one, other = machines
        _call(*one.inside("ip", "link", "add", CABLE, "type", "veth", "peer", "name", CABLE, "netns", str(other.holder)))
        for machine in machines:
            _call(*machine.inside("ip", "link", "set", "lo", "up"))
            _call(*machine.inside("ip", "address", "add", f"{machine.address}/24", "dev", CABLE))
            machine.plug()
        _until(lambda: all("state UP" in _call(*machine.inside("ip", "link", "show", CABLE)) for machine in machines))
        yield one, other


def _until(condition: Callable[[], bool]) -> None:
    """Wait until the kernel calls the cable running, up to a second after it was put in; DDS uses no interface that is not."""
    end = time.monotonic() + 10.0
    while not condition():
        if time.monotonic() > end:
            raise NotPossible("the cable does not come up within 10 s")
        time.sleep(0.05)


def _holder(stack: ExitStack) -> int:
    """Start a process in new namespaces; return its id once they are there."""
    words = ["setpriv", "--pdeathsig", "KILL", "unshare", "--net", "--mount", "sh", "-c"]
    script = "mount -t tmpfs tmpfs /dev/shm && echo ready && exec sleep 100000"
    holder = subprocess.Popen([*words, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    stack.callback(holder.communicate)
    stack.callback(holder.kill)
    assert holder.stdout is not None and holder.stderr is not None
    if holder.stdout.readline() != "ready\n":
        raise NotPossible(holder.stderr.read().strip() or "unshare failed")
    return holder.pid


@dataclass
class Session:
    """Launches and watches on machines; what the watches hear is in `statuses`, in the order of its arrival."""

    folder: Path
    domain: int
    statuses: list[ReceivedStatus] = field(default_factory=list)
    _running: list[subprocess.Popen[str]] = field(default_factory=list)

    def launch(self, machine: Machine, *arguments: str) -> subprocess.Popen[str]:
        """Start `ros2 launch tt_bringup sim.launch.yaml` with `arguments` on a machine; its words go to a file in `folder`."""
        log = (self.folder / f"launch_{len(self._running)}.txt").open("w")
        words = [sys.executable, "-m", "tt_tools.ros2", "launch", "tt_bringup", "sim.launch.yaml", *arguments]
        return self.start(machine.inside(*words), stdout=log, stderr=subprocess.STDOUT)

    def watch(self, machine: Machine, *names: str) -> None:
        """Listen to /diagnostics on a machine, to what the nodes of these names tell, or all."""
        watch = self.start(machine.inside(sys.executable, str(Path(__file__).with_name("watch.py"))), stdout=subprocess.PIPE)

        def read() -> None:
            for line in watch.stdout or ():
                status = ReceivedStatus(**json.loads(line))
                if not names or status.name in names:
                    self.statuses.append(status)

        threading.Thread(target=read, daemon=True).start()

    def start(self, command: list[str], **pipes: object) -> subprocess.Popen[str]:
        """Start a command on the domain of the session; it ends with the session."""
        ours = {"ROS_DOMAIN_ID": str(self.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": str(self.folder)}
        process = subprocess.Popen(command, env={**os.environ, **ours}, stdin=subprocess.DEVNULL, text=True, **pipes)  # type: ignore[call-overload]
        self._running.append(process)
        return process

    def wait(self, condition: Callable[[], bool], bound: float, what: str) -> None:
        """Wait until the condition holds. Raises TimeoutError after `bound` (s) or when a process ended."""
        end = time.monotonic() + bound
        while not condition():
            if ended := [process.args for process in self._running if process.poll() is not None]:
                raise TimeoutError(f"{what}: {ended} ended")
            if time.monotonic() > end:
                last = {t.name: t.message for t in self.statuses}
                raise TimeoutError(f"{what}: not within {bound:g} s; last told: {last}")
            time.sleep(0.02)

    def balls(self, since: float = 0.0) -> list[ReceivedStatus]:
        """Return what the simulator told of each ball that was launched after `since` (s)."""
        over = [t for t in self.statuses if t.event is Event.BALL_OVER]
        return [ball for ball in over if json.loads(ball.values["launched"])[0] > since]

    def latencies(self, since: float = 0.0) -> list[float]:
        """Return the time from the last frame to the first command of each swing since `since` (s), in ms."""
        begun = [t for t in self.statuses if t.event is Event.FIRST_COMMAND and t.time > since]
        return [float(t.values["latency_ms"]) for t in begun]

    def close(self) -> None:
        """End all that was started, the last one first."""
        for process in reversed(self._running):
            process.send_signal(signal.SIGINT)
        for process in reversed(self._running):
            with suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
            process.kill()
            process.wait()


def longest_publish(one: Machine, other: Machine, folder: Path, domain: int, disturb: Callable[[], None]) -> float:
    """Return the longest time (s) in publish() on `one`, heard on `other`, while `disturb` is called and until 6 s are over."""
    session, script = Session(folder, domain), str(Path(__file__).with_name("publish.py"))
    peers = ["env", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", f"ROS_STATIC_PEERS={one.address};{other.address}"]
    try:
        session.start(other.inside(*peers, sys.executable, script))
        publisher = session.start(one.inside(*peers, sys.executable, script, "6.0"), stdout=subprocess.PIPE)
        assert publisher.stdout is not None
        publisher.stdout.readline()  # matched
        disturb()
        return float(publisher.stdout.readline())
    finally:
        session.close()


def is_hit(ball: ReceivedStatus) -> bool:
    """Whether the racket touched the ball."""
    return json.loads(ball.values["hit"]) is not None


@contextmanager
def one_host(machine: Machine, folder: Path, domain: int, bag: Path, *arguments: str) -> Iterator[Session]:
    """The whole robot and a recorder on one machine."""
    session = Session(folder, domain)
    try:
        session.launch(machine, "record:=true", f"output:={bag}", *arguments)
        session.watch(machine)
        yield session
    finally:
        session.close()


@contextmanager
def two_hosts(one: Machine, other: Machine, folder: Path, domain: int, bag: Path, *arguments: str) -> Iterator[Session]:
    """Simulator and measurement on `one`; prediction, strokes, arm and recorder on `other`.

    Each machine's nodes are watched there: while the cable is out their words do not reach the other one.
    """
    session = Session(folder, domain)
    try:
        session.launch(one, f"peers:={other.address}", "arm:=false", *arguments)
        session.launch(other, f"peers:={one.address}", "vision:=false", "record:=true", f"output:={bag}", *arguments)
        session.watch(one, "sim", "estimate")
        session.watch(other, "predict", "racket", "arm", "watch")
        yield session
    finally:
        session.close()
