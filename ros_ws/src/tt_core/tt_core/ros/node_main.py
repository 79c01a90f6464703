"""The function that runs a node, shared by all nodes."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.time_source import TimeSource
from rosgraph_msgs.msg import Clock

from ..errors import TtError
from ..exit_timer import end_by_signal
from ..priority import ORDINARY, Priority, set_nice, set_realtime
from ..revision import package_version
from ..shared_memory import SMALL_SEGMENT, set_segment
from ..start import SIGNALS, default_signals
from .params import changed_parameters
from .presence import Presence
from .restart import changeable_parameters, restart, watch_standstill

USUAL_THRESHOLD = gc.get_threshold()  # when Python searches for garbage: after 700 new objects, and so on
START_THRESHOLD = 100_000  # new objects between two searches until the node is made; with 700 they take an eighth of the start
START_TIMEOUT = 120.0  # s for rclpy.init and the constructor of a node, which usually take 2 s, or 100 s if all functions must be compiled
THREADS = 1.0  # s that the threads of a node may take to end after its context
EXIT_TIMEOUT = 2.0  # s that a process may take to end after a signal has ended its node
OWN_EXIT_TIMEOUT = 15.0  # s that a process may take to end by itself. A signal would hide its exit code, so this is longer


def run(make: Callable[[], Node], priority: Priority = ORDINARY, segment: int = SMALL_SEGMENT) -> None:
    """Run one node until SIGINT or SIGTERM, then call its method `close` if it has one, and destroy it and its context.

    While the node is made, these signals end the process at once: nothing is open yet, and Python's KeyboardInterrupt would be lost in a C
    callback. While `close` runs they wait. Afterwards they end the process at once again.

    When the node is ready it logs one line with its version and the parameters that differ from the defaults. A node may add to this line
    by an attribute `about`. A node whose name begins with _ logs nothing.

    A node may end by `rclpy.try_shutdown()` in a callback. Callbacks that wait in the executor's queue still run after that, so they must
    check `rclpy.ok()` before they use the node.

    A process that has stood still for so long that other nodes may have removed it from discovery is replaced by a new one with the same
    command and the present parameters: after such a standstill Fast DDS sometimes never connects some publishers and subscriptions again. A
    node whose attribute `kept_parameters` is None goes on instead. Otherwise these parameters, by name, are given to the new process, too.
    A process with a low priority (`priority.nice` above 0) also goes on: on a busy machine it stands still so often that it would never
    finish to start anew.

    A node that is not made within 120 s, because DDS or a library never returns, ends the process with exit code 1 and the stacks of its
    threads, so that a launch file starts it again. Functions that were compiled until then are not compiled again.

    Bad parameters, a TtError raised by `make`, end the process with one line and exit code 2. An exception in a callback or a thread of the
    node ends the process after `close`, with one line and exit code 1; the traceback is logged at the level DEBUG. Threads must end with
    the context; their errors after the end of the context are ignored.

    Sometimes Fast DDS deadlocks while its entities are destroyed (its issue 6502), and holds the global interpreter lock (GIL). Therefore
    the end is bounded: a process that has received a signal is ended by this signal 2 s after `close`; a process that ends by itself is
    ended by SIGTERM after 15 s.

    Args:
        make: Returns the node.
        priority: Scheduling priority of the process. It is real-time once the node is made. If the system does not permit it (`ulimit -r`,
            `ulimit -e`), the process prints a line and runs at what is permitted.
        segment: bytes, shared memory for what the process sends; IMAGE_SEGMENT if it sends images.
    """
    default_signals()
    set_segment(segment)
    _bound_clock()
    is_nice = _set_nice(priority.nice)
    faulthandler.dump_traceback_later(START_TIMEOUT, exit=True)
    gc.set_threshold(START_THRESHOLD)
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # RCLError: arguments of ROS that are none
        print(str(error).partition(", at /")[0], file=sys.stderr)
        raise SystemExit(2) from None
    node = _made(make)
    faulthandler.cancel_dump_traceback_later()
    if node is None:
        end_by_signal(signal.SIGTERM, OWN_EXIT_TIMEOUT)
        gc.collect()  # what there is of the node goes, with the threads of its participant
        rclpy.try_shutdown()
        raise SystemExit(2)
    asked, crashes = Future(), list[BaseException]()

    def on_thread_exception(crash: threading.ExceptHookArgs) -> None:
        if rclpy.ok() and crash.exc_value is not None:
            crashes.append(crash.exc_value)
            asked.set_result(None)

    threading.excepthook = on_thread_exception
    kept = list[dict[str, Any]]()  # parameter values for the restart after a standstill; empty if there is none

    def on_standstill(seconds: float) -> None:
        parameters = getattr(node, "kept_parameters", {}) if priority.nice <= 0 else None
        if parameters is not None and rclpy.ok():
            node.get_logger().warning(f"stood still for {seconds:.1f} s, for which other nodes may have lost this one: it starts anew")
            kept.append(changeable_parameters(node) | parameters)
            asked.set_result(None)

    Presence(node)
    _set_realtime(priority, is_nice)
    received = list[int]()
    try:
        with _signals(asked, received), watch_standstill(on_standstill):
            _log_ready(node)
            _spin(node, asked)
    except Exception as error:
        crashes.append(error)
    finally:
        number, timeout = (received[0], EXIT_TIMEOUT) if received else (signal.SIGTERM, OWN_EXIT_TIMEOUT)
        end_by_signal(number, timeout)
        rclpy.try_shutdown()
        join_threads()
        _print_crashes(node, crashes)
        node.destroy_node()
    if crashes:
        raise SystemExit(1)
    if kept and not received:
        restart(kept[0])


def _log_ready(node: Node) -> None:
    if node.get_name().startswith("_"):
        return
    package = type(node).__module__.partition(".")[0]
    changed = [f"{name} = {value}" for name, value in changed_parameters(node).items()]
    parts = [f"{package} {package_version(package)}", *filter(None, [getattr(node, "about", "")]), *changed]
    node.get_logger().info(f"ready: {', '.join(parts)}")


def _print_crashes(node: Node, crashes: Sequence[BaseException]) -> None:
    for crash in crashes:
        node.get_logger().debug("".join(traceback.format_exception(crash)))
        frames = traceback.extract_tb(crash.__traceback__)
        where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        kind = "" if isinstance(crash, TtError) else f"{type(crash).__name__}: "
        print(f"{kind}{crash}{where}", file=sys.stderr, flush=True)


def _bound_clock() -> None:
    """Ignore a /clock before 1970, on which rclpy 7.1.6 ends the node."""
    follow = TimeSource.clock_callback

    def clock_callback(source: TimeSource, message: Clock) -> None:
        if message.clock.sec >= 0:
            follow(source, message)

    TimeSource.clock_callback = clock_callback  # type: ignore[assignment]


def _set_nice(nice: int) -> bool:
    """Return whether the nice value is permitted. Before any thread is started: they inherit it."""
    try:
        if nice:
            set_nice(nice)
    except PermissionError:
        return False
    return True


def _set_realtime(priority: Priority, is_nice: bool) -> None:
    """After the node was made: loading and compiling take seconds, for which other programs are not to be stopped."""
    if not priority.realtime:
        return
    try:
        set_realtime(priority.realtime)
    except PermissionError:
        instead = f"runs at nice {priority.nice}" if is_nice else f"nor for nice {priority.nice} (ulimit -e)"
        print(
            f"no permission for real-time priority {priority.realtime} (ulimit -r), {instead}: on a busy machine answers may come late",
            file=sys.stderr,
        )


def _made(make: Callable[[], Node]) -> Node | None:
    try:
        return make()
    except TtError as error:
        print(error, file=sys.stderr)
        return None


def _spin(node: Node, asked: Future) -> None:
    gc.freeze()  # what is there now lives as long as the node; to look through it again and again takes 50 ms each time
    gc.set_threshold(*USUAL_THRESHOLD)
    executor = EventsExecutor()
    try:
        executor.add_node(node)
        with suppress(ExternalShutdownException):  # the node itself ended the context
            while not asked.done():  # waits without a timeout never dispatch in rclpy 7.1.6
                executor.spin_until_future_complete(asked, 3600.0)
    finally:
        executor.shutdown()
        if hasattr(node, "close"):
            node.close()


@contextmanager
def _signals(asked: Future, received: list[int]) -> Iterator[None]:
    """Append SIGINT and SIGTERM to `received`. The first one completes `asked`, a second one takes effect when the context is left."""
    read, write = os.pipe()

    def wait() -> None:  # a thread, because Python's own handlers wait until the executor returns
        os.read(read, 1)
        asked.set_result(None)

    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    for number in SIGNALS:
        signal.signal(number, lambda number, _: received.append(number))
    threading.Thread(target=wait, name="signals", daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(-1)
        os.close(write)
        default_signals()
        if len(received) > 1:
            signal.raise_signal(received[-1])


def join_threads() -> None:
    """Wait for the threads of the nodes of this process, at most THREADS s, after the end of the context and before nodes are destroyed.

    A thread that is inside a call of DDS while the interpreter ends would abort the process.
    """
    end = time.monotonic() + THREADS
    for thread in threading.enumerate():
        if type(thread) is threading.Thread:
            thread.join(max(0.0, end - time.monotonic()))
