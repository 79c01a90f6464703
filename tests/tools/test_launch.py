"""Launch files: read as the ROS 2 frontend reads them, refused with the reason, and kept together while they run."""

import ast
import os
import re
import signal
import sys
import time
from pathlib import Path

import pytest
import yaml
from refusals import refused
from tt_tools import packages
from tt_tools.launch import REFUSED, RESTARTS, LaunchError, Process, System, declared_arguments, processes, read_launch_file, substitute

SOURCES = Path(__file__).parents[2] / "ros_ws" / "src"
LAUNCH_FILES = sorted((SOURCES / "tt_bringup" / "launch").glob("*.launch.yaml"))
SCRIPTS = sorted(SOURCES.glob("*/scripts/*"))
NODE = """
launch:
  - arg: {name: speed, default: "1.0"}
  - arg: {name: spare, default: "false"}
  - node:
      pkg: some_package
      exec: some_node
      name: left
      namespace: arm
      args: "--file 'a b' $(var speed)"
      param:
        - {name: speed, value: $(var speed)}
        - {name: limits, value: [1.0, 2.5]}
        - {name: device, value: $(env TT_UNKNOWN 0), type: str}
        - {from: $(dirname)/more.yaml}
      remap:
        - {from: /in, to: /out}
  - node: {pkg: some_package, exec: some_node, name: spare, if: $(var spare), respawn: "true", respawn_delay: 2.5, respawn_max_retries: 3}
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    """file(text) is the path of a launch file; its packages are all installed in /opt."""
    monkeypatch.setattr(packages, "executable", lambda package, name: Path("/opt", package, name))

    def file(text):
        path = tmp_path / "test.launch.yaml"
        path.write_text(text)
        return path

    return file


def test_a_node_becomes_a_command_with_ros_arguments(file, tmp_path):
    (node,) = processes(file(NODE), {"speed": "2.5"})
    ours, ros = node.command[: node.command.index("--ros-args")], node.command[node.command.index("--ros-args") + 1 :]
    assert node.name == "left" and not node.required
    assert ours == ("/opt/some_package/some_node", "--file", "a b", "2.5")
    assert set(zip(ros[::2], ros[1::2], strict=True)) == {
        ("-r", "__node:=left"),
        ("-r", "__ns:=/arm"),
        ("-r", "/in:=/out"),
        ("-p", "speed:=2.5"),
        ("-p", "limits:=[1.0, 2.5]"),
        ("-p", 'device:="0"'),
        ("--params-file", f"{tmp_path}/more.yaml"),
    }


def test_a_condition_decides(file):
    left, spare = processes(file(NODE), {"spare": "true"})
    assert (left.name, left.respawn, left.respawn_max_retries) == ("left", False, -1)
    assert (spare.name, spare.respawn, spare.respawn_delay, spare.respawn_max_retries) == ("spare", True, 2.5, 3)
    with refused(LaunchError, "maybe"):
        processes(file(NODE), {"spare": "maybe"})


def test_substitutions(monkeypatch, tmp_path):
    monkeypatch.setenv("TT_KNOWN", "here")
    assert substitute("$(var a)-$(env TT_KNOWN)-$(env TT_UNKNOWN else)", {"a": "1"}) == "1-here-else"
    for bad in ("$(var b)", "$(env TT_UNKNOWN)", "$(eval 1)", "$(var $(var a))", "$(var a"):
        with pytest.raises(LaunchError):
            substitute(bad, {"a": "1"})
    assert substitute("$(var a)", {"a": "$(var a)"}) == "$(var a)"  # a value is no program
    assert substitute("$(not-equals $(var a) here)", {"a": "here"}) == "false"
    assert substitute("$(and $(var a) true)", {"a": "true"}) == "true"
    assert substitute("$(and $(var a) true)", {"a": "false"}) == "false"
    assert substitute("$(not-equals $(var a) here)", {"a": "here or there"}) == "true"


@pytest.mark.parametrize("name, sees", [("sim", "sim"), ("robot", "camera")])
def test_one_argument_opens_the_graph_to_other_machines(name, sees):
    """Each machine starts its part; without `peers` the environment stays as it is."""
    path = SOURCES / "tt_bringup" / "launch" / f"{name}.launch.yaml"
    whole = processes(path, {"record": "false", "enabled": "true"})
    planning = ["predict", "racket", "arm", "enable", "markers", "robot_state_publisher"]
    assert [process.name for process in whole] == [sees, "estimate", *planning]
    assert not any(process.environment for process in whole)
    opened = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": "192.168.1.2;other.local"}
    for part, names in (("arm", [sees, "estimate"]), ("vision", planning)):
        started = processes(path, {"record": "false", "enabled": "true", "peers": "192.168.1.2;other.local", part: "false"})
        assert [process.name for process in started] == names
        assert all(process.environment == opened for process in started)


@pytest.mark.parametrize(
    "text, named",
    [
        ("launch: [{group: []}]", ("group", "arg", "set_env", "node", "executable")),
        ("launch: [{node: {pkg: a, exec: b, respwan: true}}]", ("node", "respwan", "respawn")),
        ("launch: [{arg: {name: a, default: 1.0}}]", ("a", 1.0)),
        ("launch: [{arg: {name: a, description: why}}]", ("a", "why")),
        ("launch: [{executable: {cmd: ls, on_exit: respawn}}]", ("on_exit", "respawn")),
        ("launch: [{node: {pkg: a, exec: b, param: [{name: c, value: ''}]}}]", ("c", "b")),
        ("launch: [{node: {pkg: a, exec: b, respawn_delay: '1.0'}}]", ("respawn_delay", "1.0")),
        ("launch: [{node: {pkg: a, exec: b, respawn_delay: -1.0}}]", ("respawn_delay", -1.0)),
        ("launch: [{node: {pkg: a, exec: b, respawn_max_retries: many}}]", ("respawn_max_retries", "many")),
        ("launch: [{node: {pkg: a, exec: b, respawn: perhaps}}]", ("perhaps",)),
        ("nodes: []", ("launch.yaml",)),
        ("launch: [", ("launch.yaml",)),
    ],
)
def test_a_bad_file_says_what_is_wrong(file, text, named):
    with refused(LaunchError, *named):
        processes(file(text))


def test_an_unknown_argument_names_the_known_ones(file):
    with refused(LaunchError, "sped", "speed", "spare"):
        processes(file(NODE), {"sped": "1"})


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_our_nodes_exist(path):
    """Every node is installed by its package, and every argument is told and used."""
    for kind, keys in read_launch_file(path):
        if kind == "node":
            setup = (SOURCES / keys["pkg"] / "setup.py").read_text()
            assert f"scripts/{keys['exec']}" in {node.value for node in ast.walk(ast.parse(setup)) if isinstance(node, ast.Constant)}
    for argument in declared_arguments(path):
        assert argument.description
        assert f"$(var {argument.name})" in path.read_text()


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_our_executables_start_a_module_with_interrupts_blocked(script):
    shebang, *_, guard, last = script.read_text().splitlines()
    assert shebang == "#!/usr/bin/env -S --block-signal=INT python3" and os.access(script, os.X_OK)
    assert guard == 'if __name__ == "__main__":'  # worker processes import the executable (multiprocessing, "spawn")
    module = re.fullmatch(r' {4}start\("(\w+)\.([\w.]+)"\)', last)
    assert module and "def main(" in (SOURCES / module[1] / module[1] / f"{module[2].replace('.', '/')}.py").read_text()


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_our_files_are_what_the_frontend_of_ros_takes(path):
    """It wants strings for all attributes but the values of parameters and some numbers (launch_yaml 3.4)."""
    numbers = {"respawn_delay": float, "respawn_max_retries": int}
    for entry in yaml.safe_load(path.read_text())["launch"]:
        for key, value in next(iter(entry.values())).items():
            assert key in ("param", "remap") or type(value) is numbers.get(key, str), f"{key}: {value!r}"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_our_nodes_are_started_again_but_the_arm_is_enabled_once(path):
    """What a restart would repeat is in no parameter. A view that cannot serve its page does not end the robot."""
    nodes = [keys for kind, keys in read_launch_file(path) if kind == "node"]
    again = {keys["exec"] for keys in nodes if keys.get("respawn") == "true"}
    assert again == {keys["exec"] for keys in nodes} - {"play_node", "enable", "robot_state_publisher", "view_node"}
    assert all(keys.get("respawn") == "true" or "on_exit" in keys for keys in nodes if keys["exec"] in again)
    assert "enabled" not in {param.get("name") for keys in nodes for param in keys.get("param", ())}


def python(text):
    return (sys.executable, "-c", text)


def group_is_gone(pid):
    """Within 5 s: whoever was killed stands in the process table until its new parent has seen it."""
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        try:
            os.killpg(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def test_the_end_of_a_required_process_is_the_end_of_all():
    printed = []
    endless = python("import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(600)'])")
    with System([Process("one", python("print('hello')"), required=True), Process("two", endless)], printed.append) as system:
        assert system.wait(timeout=120)
    assert "[one] hello" in printed and not system.failed
    started = [int(line.split()[-1]) for line in printed if "started" in line]
    assert len(started) == 2 and all(group_is_gone(pid) for pid in started)


def test_a_process_has_its_own_variables_beside_ours(monkeypatch):
    monkeypatch.setenv("TT_OURS", "ours")
    printed = []
    show = Process("one", python("import os; print(os.environ['TT_OURS'], os.environ['TT_ITS'])"), environment={"TT_ITS": "its"})
    with System([show], printed.append) as system:
        assert system.wait(timeout=120)
    assert "[one] ours its" in printed


def test_a_failure_is_remembered_and_the_others_go_on():
    printed = []
    with System([Process("bad", python("raise SystemExit(3)")), Process("good", python("input()"))], printed.append) as system:
        assert system.wait(timeout=120)
    assert system.failed == {"bad": 3, "good": 1}  # its standard input is empty


def test_who_does_not_listen_is_killed(monkeypatch):
    monkeypatch.setattr("tt_tools.launch.SIGNAL_TIMEOUT", 0.5)
    deaf = "import signal, time\nfor n in (2, 15): signal.signal(n, signal.SIG_IGN)\nprint('deaf', flush=True)\ntime.sleep(600)"
    system = System([Process("deaf", python(deaf))], lambda line: line == "[deaf] deaf" and system.interrupt())
    with system:
        assert system.wait(timeout=120)
    assert system.failed == {"deaf": -signal.SIGKILL}


def test_what_cannot_start_stops_the_rest():
    printed = []
    with (
        refused(LaunchError, "two", "/no/such/program"),
        System([Process("one", python("import time; time.sleep(600)")), Process("two", ("/no/such/program",))], printed.append),
    ):
        pass
    assert group_is_gone(int(printed[0].split()[-1]))


def started(printed):
    """Process ids, in the order of their start."""
    return [int(line.split()[-1]) for line in printed if "started, process" in line]


def test_what_was_killed_is_started_again():
    printed = []
    endless = Process("endless", python("import time; print('up', flush=True); time.sleep(600)"), respawn=True, respawn_delay=0.1)
    with System([endless, Process("other", python("import time; time.sleep(600)"))], printed.append) as system:
        for lives in range(1, 4):
            end = time.monotonic() + 20.0
            while printed.count("[endless] up") < lives:
                assert time.monotonic() < end and not system.wait(timeout=0.05)
            assert len(started(printed)) == 1 + lives
            os.kill([int(line.split()[-1]) for line in printed if "endless started" in line][-1], signal.SIGKILL)
        assert not system.wait(timeout=0.05)
    assert not system.failed and all(group_is_gone(pid) for pid in started(printed))


def test_what_dies_again_and_again_is_given_up_and_all_end():
    printed = []
    sick = Process("sick", python("raise SystemExit(3)"), respawn=True)
    with System([sick, Process("well", python("import time; time.sleep(600)"))], printed.append) as system:
        assert system.wait(timeout=120)
    assert system.failed == {"sick": 3}
    assert sum("sick started" in line for line in printed) == 1 + RESTARTS
    assert sum("not started again" in line for line in printed) == 1


@pytest.mark.parametrize(
    ("code", "retries", "starts", "goes_on"),
    [(REFUSED, -1, 1, False), (3, 2, 3, True), (0, 1, 2, True)],
)
def test_who_is_not_started_again(code, retries, starts, goes_on):
    """What refuses its parameters ends all; what has used up its retries stays away, as in ROS 2 launch."""
    printed = []
    brief = Process("brief", python(f"raise SystemExit({code})"), respawn=True, respawn_max_retries=retries)
    with System([brief, Process("last", python("import sys; sys.stdin.read()"))], printed.append) as system:
        assert system.wait(timeout=120)
    assert sum("brief started" in line for line in printed) == starts
    assert system.failed == ({"brief": code} if code else {})
    assert not goes_on or "[launch] last ended, exit code 0" in printed


def test_nothing_is_started_again_when_all_end():
    printed = []
    slow = Process("slow", python("raise SystemExit(3)"), respawn=True, respawn_delay=60.0)
    with System([slow], lambda line: (printed.append(line), "slow ended" in line and system.interrupt())) as system:
        assert system.wait(timeout=120)
    assert sum("started" in line for line in printed) == 1


@pytest.mark.parametrize("name", ["sim", "robot", "replay"])
def test_further_parameters_come_after_those_of_the_robot(name, tmp_path):
    """What calibrate and identify write wins over the file of the robot, and arguments win over both."""
    (tmp_path / "found.yaml").write_text("/**/predict: {ros__parameters: {physics: measured}}")
    given = {"record": "false", "more_params_file": str(tmp_path / "found.yaml"), "physics": "liu"}
    found = processes(SOURCES / "tt_bringup" / "launch" / f"{name}.launch.yaml", given | ({"bag": "bag"} if name == "replay" else {}))
    (predict,) = [process for process in found if process.name == "predict"]
    words = " ".join(predict.command)
    assert words.index("parameters.yaml") < words.index("found.yaml") < words.index("physics:=liu")
    with refused(LaunchError, tmp_path / "nothing.yaml"):
        processes(
            SOURCES / "tt_bringup" / "launch" / f"{name}.launch.yaml",
            given | {"more_params_file": str(tmp_path / "nothing.yaml"), "bag": "b"}
            if name == "replay"
            else given | {"more_params_file": str(tmp_path / "nothing.yaml")},
        )
