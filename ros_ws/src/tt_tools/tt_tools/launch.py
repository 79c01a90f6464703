"""Start the processes of a launch file, restart them if the file asks for it, and end them together.

Launch files are those of the YAML frontend of ROS 2 launch, https://github.com/ros2/launch. This module reads the part of the language that
the project uses: the entries and keys of `_KEYS`, and the substitutions $(var NAME), $(env NAME DEFAULT), $(find-pkg-share PKG),
$(dirname), $(not-equals A B) and $(and A B), whose operands may be substitutions themselves.
"""

from __future__ import annotations

import json
import os
import queue
import re
import shlex
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from tt_core.errors import TtError

from . import packages

SIGNAL_TIMEOUT = 5.0  # s from SIGINT to SIGTERM and from there to SIGKILL, as in ROS 2 launch
# the kernel ends our processes if this one is killed
END_WITH_PARENT = ("setpriv", "--pdeathsig", "TERM") if shutil.which("setpriv") else ()
RESTARTS, WITHIN = 5, 60.0  # most restarts of one process within so many s; if it ends once more, all processes are ended
REFUSED = 2  # exit code of a node that refuses its parameters: it is not restarted, because it would refuse them again
STOPPED = {0, -signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGINT, 128 + signal.SIGTERM}  # exit codes that are not a failure

_SHARED = {"name", "if", "unless", "on_exit", "output", "respawn", "respawn_delay", "respawn_max_retries"}
_KEYS = {
    "arg": {"name", "default", "description"},
    "set_env": {"name", "value", "if", "unless"},
    "push_ros_namespace": {"namespace", "if", "unless"},
    "set_remap": {"from", "to", "if", "unless"},
    "set_parameters_from_file": {"filename", "if", "unless"},
    "set_parameter": {"name", "value", "if", "unless"},
    "node": _SHARED | {"pkg", "exec", "namespace", "param", "remap", "args"},
    "executable": _SHARED | {"cmd"},
}
_OPERAND = re.compile(r"\$\([\w-]+(?: +[^\s()]+)*\)|[^\s()]+")
_SUBSTITUTION = re.compile(rf"\$\(([\w-]+)((?: +(?:{_OPERAND.pattern}))*)\)")


class LaunchError(TtError):
    """Error: a launch file, or an argument of it, cannot be used."""


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument that a launch file declares.

    Attributes:
        name: Name of the argument.
        default: Its value unless one is given; None if one must be given.
        description: What it means, for people.
    """

    name: str
    default: str | None
    description: str


@dataclass(frozen=True, slots=True)
class Process:
    """A process that a launch file starts.

    Attributes:
        name: Name before each line of its output.
        command: The program and its arguments.
        required: Whether all processes are ended when this one ends (`on_exit: shutdown`).
        environment: Environment variables that are set for it, in addition to those of this process.
        respawn: Whether it is started again when it has ended; without effect if it is required.
        respawn_delay: Time from its end to its restart, s.
        respawn_max_retries: Most restarts; -1 for no limit. Independent of it, RESTARTS limits how often it may end in WITHIN s.
    """

    name: str
    command: tuple[str, ...]
    required: bool = False
    environment: Mapping[str, str] = field(default_factory=dict, hash=False)
    respawn: bool = False
    respawn_delay: float = 0.0
    respawn_max_retries: int = -1


def read_launch_file(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Read a launch file.

    Returns:
        For each entry its kind, e.g. "node", and its keys with their values, in the order of the file. Nothing is substituted yet.

    Raises:
        LaunchError: The file is no launch file, or uses a part of the language that is not supported here.
    """
    try:
        entries = yaml.safe_load(path.read_text())["launch"]
        found = [next(iter(entry.items())) for entry in entries if len(entry) == 1]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise LaunchError(f"{path} is no launch file: {error!r}") from error
    for kind, keys in found:
        if kind not in _KEYS:
            raise LaunchError(f"{path}: {kind!r} is none of {', '.join(_KEYS)}")
        if unknown := keys.keys() - _KEYS[kind]:
            raise LaunchError(f"{path}: {kind} has no {', '.join(sorted(unknown))}; it has {', '.join(sorted(_KEYS[kind]))}")
    return found


def declared_arguments(path: Path) -> list[Argument]:
    """Return the arguments that a launch file declares. Raises LaunchError if the file is no launch file."""
    return [
        Argument(keys["name"], keys.get("default"), keys.get("description", "")) for kind, keys in read_launch_file(path) if kind == "arg"
    ]


def is_true(text: str) -> bool:
    """Return the value of a condition: True for "true" and "1", False for "false" and "0". Raises LaunchError for other texts."""
    if text.lower() not in ("true", "1", "false", "0"):
        raise LaunchError(f"a condition is {text!r}, neither true nor false")
    return text.lower() in ("true", "1")


def substitute(text: str, values: Mapping[str, str], folder: Path = Path(), quote: Callable[[str], str] = str) -> str:
    """Return a text in which substitutions are replaced by their values.

    Args:
        text: Text with substitutions such as $(var name).
        values: Values of the launch file's arguments, by name.
        folder: Folder of the launch file, the value of $(dirname).
        quote: Function that is applied to each value before it is inserted, e.g. shlex.quote.

    Raises:
        LaunchError: A substitution is unknown, has no value, or is not closed.
    """

    def value(match: re.Match[str]) -> str:
        word, given = match[1], _OPERAND.findall(match[2])
        if word == "var" and len(given) == 1 and given[0] in values:
            return quote(values[given[0]])
        if word == "env" and len(given) in (1, 2) and (found := os.environ.get(*given)) is not None:
            return quote(found)
        if word == "find-pkg-share" and len(given) == 1:
            return quote(str(packages.share(given[0])))
        if word == "dirname":
            return quote(str(folder))
        if word in ("not-equals", "and") and len(given) == 2:
            left, right = (substitute(operand, values, folder) for operand in given)
            return str(left != right if word == "not-equals" else is_true(left) and is_true(right)).lower()
        raise LaunchError(f"{match[0]} has no value here")

    if "$(" in _SUBSTITUTION.sub("", text):
        raise LaunchError(f"{text!r} holds a substitution that is not closed")
    return _SUBSTITUTION.sub(value, text)


def existing_parameter_file(name: str) -> str:
    """Return the absolute path of a parameter file. Raises LaunchError if the file does not exist."""
    path = Path(name).absolute()
    if not path.is_file():
        raise LaunchError(f"there is no parameter file {path}")
    return str(path)


def processes(path: Path, given: Mapping[str, str] | None = None) -> list[Process]:
    """Return the processes that a launch file starts.

    Args:
        path: The launch file.
        given: Values of its arguments, by name; the others have their defaults.

    Raises:
        LaunchError: The launch file or an argument cannot be used.
        NotFound: A package or an executable is not installed.
    """
    path, given = Path(path).absolute(), given or {}
    declared = {argument.name: argument for argument in declared_arguments(path)}
    if unknown := given.keys() - declared.keys():
        raise LaunchError(f"{path.name} has no argument {', '.join(sorted(unknown))}; it has {', '.join(declared) or 'none'}")
    values: dict[str, str] = {}
    for name, argument in declared.items():
        default = argument.default
        if name not in given and default is None:
            raise LaunchError(f"{path.name} needs {name}:= ({argument.description})")
        if default is not None and not isinstance(default, str):
            raise LaunchError(f"{path.name}: default of {name} must be a quoted string, got {default!r}")
        values[name] = given[name] if name in given else substitute(default or "", values, path.parent)

    def fill(text: str) -> str:
        return substitute(text, values, path.parent)

    def words(text: str) -> list[str]:
        return shlex.split(substitute(text, values, path.parent, shlex.quote))

    def holds(condition: str) -> bool:
        return is_true(fill(str(condition)))

    def options(keys: dict[str, Any]) -> Iterator[str]:
        if "name" in keys:
            yield from ("-r", f"__node:={fill(keys['name'])}")
        if namespace or "namespace" in keys:
            yield from ("-r", f"__ns:={namespace}/{fill(keys.get('namespace', '')).strip('/')}".rstrip("/"))
        for remap in (*remaps, *keys.get("remap", ())):
            yield from ("-r", f"{fill(remap['from'])}:={fill(remap['to'])}")
        yield from parameters
        for param in keys.get("param", ()):
            if "from" in param:
                yield from ("--params-file", fill(param["from"]))
                continue
            value = fill(param["value"]) if isinstance(param["value"], str) else json.dumps(param["value"])
            if param.get("type") == "str":
                value = json.dumps(value)
            if not value:
                raise LaunchError(f"parameter {param['name']} of {keys['exec']} is empty; it needs type: str")
            yield from ("-p", f"{fill(param['name'])}:={value}")

    found, environment = [], dict[str, str]()
    namespace, remaps, parameters = "", list[dict[str, str]](), list[str]()  # apply to all nodes that follow in the file
    for kind, keys in read_launch_file(path):
        if kind == "arg" or not holds(keys.get("if", "true")) or holds(keys.get("unless", "false")):
            continue
        if kind == "set_env":
            environment = {**environment, fill(keys["name"]): fill(keys["value"])}
            continue
        if kind == "push_ros_namespace":
            namespace += f"/{fill(keys['namespace']).strip('/')}"
            continue
        if kind == "set_remap":
            remaps.append(keys)
            continue
        if kind == "set_parameters_from_file":
            parameters += ["--params-file", existing_parameter_file(fill(keys["filename"]))]
            continue
        if kind == "set_parameter":
            parameters += ["-p", f"{fill(keys['name'])}:={fill(str(keys['value']))}"]
            continue
        if keys.get("on_exit", "shutdown") != "shutdown":
            raise LaunchError(f"{path.name}: on_exit can only be shutdown, got {keys['on_exit']!r}")
        delay, retries = keys.get("respawn_delay", 0.0), keys.get("respawn_max_retries", -1)
        if not isinstance(delay, float) or delay < 0.0:
            raise LaunchError(f"{path.name}: respawn_delay must be a number such as 1.0 and not negative, got {delay!r}")
        if not isinstance(retries, int):
            raise LaunchError(f"{path.name}: respawn_max_retries must be a whole number, got {retries!r}")
        if kind == "node":
            program = packages.executable(fill(keys["pkg"]), fill(keys["exec"]))
            command, ros = [str(program), *words(keys.get("args", ""))], list(options(keys))
            command += ["--ros-args", *ros] if ros else []
        else:
            command = words(keys["cmd"])
        name = fill(keys["name"]) if "name" in keys else Path(command[0]).name
        respawn = holds(keys.get("respawn", "false"))
        found.append(Process(name, tuple(command), "on_exit" in keys, environment, respawn, delay, retries))
    return found


class System:
    """The running processes of a launch file. It is a context manager that starts them on entry and ends all of them on exit.

    Each process runs in a session of its own. Each line of its output is passed on with its name before it. The processes also end when the
    thread that entered the context ends. Processes that have ended are restarted only while `wait` runs.

    Attributes:
        failed: Exit codes of the processes that failed, by name.
    """

    def __init__(self, processes: Sequence[Process], write_line: Callable[[str], None] = lambda line: print(line, flush=True)) -> None:
        """Keep the processes, without starting them.

        Args:
            processes: What the context will start.
            write_line: Called with each line of output.
        """
        self.failed: dict[str, int] = {}
        self._processes, self._write_line = processes, write_line
        self._running: dict[subprocess.Popen[str], Process] = {}
        self._readers: list[threading.Thread] = []
        self._last_lines: dict[str, str] = {}  # last line of output of each process, by name
        self._restarts: dict[str, list[float]] = {}  # when each process was restarted, s of the monotonic clock
        self._pending = 0  # number of restarts that wait for their delay
        # events: a child that has ended, a process to be restarted, or None for an interrupt
        self._events: queue.SimpleQueue[subprocess.Popen[str] | Process | None] = queue.SimpleQueue()
        self._over = self._stopping = False

    def _start(self, process: Process) -> None:
        if shutil.which(process.command[0]) is None:
            raise LaunchError(f"{process.name} does not start: there is no program {process.command[0]}")
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", **process.environment}
        pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        command = (*END_WITH_PARENT, *process.command)
        child = subprocess.Popen(command, env=environment, start_new_session=True, text=True, errors="replace", **pipes)
        self._running[child] = process
        self._write_line(f"[launch] {process.name} started, process {child.pid}")

        def pass_on() -> None:
            for line in child.stdout or ():
                self._write_line(f"[{process.name}] {line.rstrip()}")
                if line.strip():
                    self._last_lines[process.name] = line.strip()

        def see_out() -> None:
            child.wait()
            self._events.put(child)

        self._readers.append(threading.Thread(target=pass_on, daemon=True))
        for thread in (self._readers[-1], threading.Thread(target=see_out, daemon=True)):
            thread.start()

    def interrupt(self) -> None:
        """End `wait`; if `stop` is running, let it send the next signal at once. A signal handler may call this."""
        self._events.put(None)

    def _next(self, timeout: float | None) -> bool:
        """Handle one event. Return False if none came within `timeout` (s), or if it was an interrupt."""
        try:
            event = self._events.get(timeout=timeout)
        except queue.Empty:
            return False
        if event is None:
            self._over = True
            return False
        if isinstance(event, Process):
            self._pending -= 1
            if not self._stopping:
                self._start(event)
        else:
            self._on_end(event)
        return True

    def _on_end(self, child: subprocess.Popen[str]) -> None:
        process = self._running.pop(child)
        self._signal(child, signal.SIGKILL)  # ends processes that it may have left in its group
        self._write_line(f"[launch] {process.name} ended, exit code {child.returncode}")
        if process.respawn and not (process.required or self._stopping) and self._restart(process, child.returncode):
            return
        interrupted = self._stopping and child.returncode > 0  # an interpreter that is still starting answers SIGINT with 1
        if child.returncode not in STOPPED and not interrupted:
            self.failed[process.name] = child.returncode
        self._over = self._over or process.required

    def _restart(self, process: Process, code: int) -> bool:
        """Schedule the restart of a process that ended with exit code `code`. Return False if it is not restarted."""
        now, times = time.monotonic(), self._restarts.setdefault(process.name, [])
        often = sum(now - at < WITHIN for at in times) >= RESTARTS
        if often or code == REFUSED:
            why = f"it ended {RESTARTS + 1} times within {WITHIN:g} s" if often else "it would refuse its parameters again"
            self._write_line(f"[launch] {process.name} is not started again: {why}; all end")
            self.failed[process.name], self._over = code, True
            return False
        if 0 <= process.respawn_max_retries <= len(times):
            return False
        times.append(now)
        self._pending += 1
        timer = threading.Timer(process.respawn_delay, self._events.put, (process,))
        timer.daemon = True
        timer.start()
        return True

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of the system, and restart processes meanwhile.

        The system has ended when a required process or all processes have ended, when a process with `respawn` ended too often or refused
        its parameters, or when `interrupt` was called.

        Args:
            timeout: Longest wait, s; None for no limit.

        Returns:
            True if the system has ended, False if the timeout passed first.
        """
        end = None if timeout is None else time.monotonic() + timeout
        while (self._running or self._pending) and not self._over:
            if not self._next(None if end is None else max(0.0, end - time.monotonic())) and not self._over:
                return False
        return True

    @staticmethod
    def _signal(child: subprocess.Popen[str], number: signal.Signals) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, number)

    def stop(self) -> None:
        """End all processes: send SIGINT, then SIGTERM and then SIGKILL to those that still run, SIGNAL_TIMEOUT s apart."""
        self._stopping = True
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child, process in self._running.items():
                if number is not signal.SIGINT:
                    self._write_line(f"[launch] {process.name} still runs: {number.name}")
                self._signal(child, number)
            end = time.monotonic() + SIGNAL_TIMEOUT
            while self._running and self._next(max(0.0, end - time.monotonic())):
                pass
        for reader in self._readers:
            reader.join(timeout=1.0)

    def write_failures(self) -> None:
        """Pass on the exit code and the last line of output of each process that failed."""
        for name, code in self.failed.items():
            self._write_line(f"[launch] {name} failed, exit code {code}: {self._last_lines.get(name, 'it wrote nothing')}")

    def __enter__(self) -> System:
        try:
            for process in self._processes:
                self._start(process)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def run_processes(processes: Sequence[Process]) -> int:
    """Run processes until they have ended or a signal arrives (SIGINT, SIGTERM or SIGHUP). To be called by the main thread only.

    Returns:
        Exit code: 1 if a process failed, otherwise 0.
    """
    system = System(processes)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: system.interrupt())
    with system:
        system.wait()
    system.write_failures()
    return 1 if system.failed else 0
