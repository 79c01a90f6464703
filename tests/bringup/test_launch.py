"""Launch files: read as the ROS 2 frontend reads them, refused with the reason, and kept together while they run."""

import ast
import os
import signal
import sys
import time
from pathlib import Path

import pytest
import yaml
from tt_bringup import packages
from tt_bringup.launch import LaunchError, Process, System, arguments, processes, read, substitute

SOURCES = Path(__file__).parents[2] / "ros_ws" / "src"
LAUNCH_FILES = sorted((SOURCES / "tt_bringup" / "launch").glob("*.launch.yaml"))
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
  - node: {pkg: some_package, exec: some_node, name: spare, if: $(var spare)}
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
    assert [node.name for node in processes(file(NODE), {"spare": "true"})] == ["left", "spare"]
    with pytest.raises(LaunchError, match="'maybe', neither true nor false"):
        processes(file(NODE), {"spare": "maybe"})


def test_substitutions(monkeypatch, tmp_path):
    monkeypatch.setenv("TT_KNOWN", "here")
    assert substitute("$(var a)-$(env TT_KNOWN)-$(env TT_UNKNOWN else)", {"a": "1"}) == "1-here-else"
    for bad in ("$(var b)", "$(env TT_UNKNOWN)", "$(eval 1)", "$(var $(var a))", "$(var a"):
        with pytest.raises(LaunchError):
            substitute(bad, {"a": "1"})
    assert substitute("$(var a)", {"a": "$(var a)"}) == "$(var a)"  # a value is no program
    assert substitute("$(not-equals $(var a) here)", {"a": "here"}) == "false"
    assert substitute("$(not-equals $(var a) here)", {"a": "here or there"}) == "true"


@pytest.mark.parametrize("name, sees", [("sim", "sim"), ("robot", "camera")])
def test_one_argument_opens_the_graph_to_other_machines(name, sees):
    """Each machine starts its part; without `peers` the environment stays as it is."""
    path = SOURCES / "tt_bringup" / "launch" / f"{name}.launch.yaml"
    whole = processes(path, {"record": "false"})
    assert [process.name for process in whole] == [sees, "estimate", "predict", "racket", "arm"]
    assert not any(process.environment for process in whole)
    opened = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": "192.168.1.2;other.local"}
    for part, names in (("arm", [sees, "estimate"]), ("vision", ["predict", "racket", "arm"])):
        started = processes(path, {"record": "false", "peers": "192.168.1.2;other.local", part: "false"})
        assert [process.name for process in started] == names
        assert all(process.environment == opened for process in started)


@pytest.mark.parametrize(
    "text, reason",
    [
        ("launch: [{group: []}]", "'group' is none of arg, set_env, node, executable"),
        ("launch: [{node: {pkg: a, exec: b, respwan: true}}]", "node has no respwan; it has"),
        ("launch: [{arg: {name: a, default: 1.0}}]", "default of a must be a quoted string, got 1.0"),
        ("launch: [{arg: {name: a, description: why}}]", r"needs a:= \(why\)"),
        ("launch: [{executable: {cmd: ls, on_exit: respawn}}]", "on_exit can only be shutdown"),
        ("launch: [{node: {pkg: a, exec: b, param: [{name: c, value: ''}]}}]", "parameter c of b is empty"),
        ("nodes: []", "is no launch file"),
        ("launch: [", "is no launch file"),
    ],
)
def test_a_bad_file_says_what_is_wrong(file, text, reason):
    with pytest.raises(LaunchError, match=reason):
        processes(file(text))


def test_an_unknown_argument_names_the_known_ones(file):
    with pytest.raises(LaunchError, match="has no argument sped; it has speed, spare"):
        processes(file(NODE), {"sped": "1"})


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_our_nodes_exist(path):
    """Every node is an entry point of its package, and every argument is told and used."""
    for kind, keys in read(path):
        if kind == "node":
            setup = (SOURCES / keys["pkg"] / "setup.py").read_text()
            scripts = {node.value.split("=")[0].strip() for node in ast.walk(ast.parse(setup)) if _is_entry_point(node)}
            if not scripts:
                pytest.skip(f"{keys['pkg']} has no node yet")
            assert keys["exec"] in scripts
    for argument in arguments(path):
        assert argument.description
        assert f"$(var {argument.name})" in path.read_text()


def _is_entry_point(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and "=" in node.value and ":" in node.value


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_our_files_are_what_the_frontend_of_ros_takes(path):
    """It wants strings for all attributes but the values of parameters (launch_yaml 3.4)."""
    for entry in yaml.safe_load(path.read_text())["launch"]:
        for key, value in next(iter(entry.values())).items():
            assert isinstance(value, str) or key in ("param", "remap"), f"{key}: {value!r}"


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
    told = []
    endless = python("import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(600)'])")
    with System([Process("one", python("print('hello')"), required=True), Process("two", endless)], told.append) as system:
        assert system.wait(timeout=20.0)
    assert "[one] hello" in told and not system.failed
    started = [int(line.split()[-1]) for line in told if "started" in line]
    assert len(started) == 2 and all(group_is_gone(pid) for pid in started)


def test_a_process_has_its_own_variables_beside_ours(monkeypatch):
    monkeypatch.setenv("TT_OURS", "ours")
    told = []
    show = Process("one", python("import os; print(os.environ['TT_OURS'], os.environ['TT_ITS'])"), environment={"TT_ITS": "its"})
    with System([show], told.append) as system:
        assert system.wait(timeout=20.0)
    assert "[one] ours its" in told


def test_a_failure_is_remembered_and_the_others_go_on():
    told = []
    with System([Process("bad", python("raise SystemExit(3)")), Process("good", python("input()"))], told.append) as system:
        assert system.wait(timeout=20.0)
    assert system.failed == {"bad": 3, "good": 1}  # its standard input is empty


def test_who_does_not_listen_is_killed(monkeypatch):
    monkeypatch.setattr("tt_bringup.launch.PATIENCE", 0.5)
    deaf = "import signal, time\nfor n in (2, 15): signal.signal(n, signal.SIG_IGN)\nprint('deaf', flush=True)\ntime.sleep(600)"
    system = System([Process("deaf", python(deaf))], lambda line: line == "[deaf] deaf" and system.interrupt())
    with system:
        assert system.wait(timeout=20.0)
    assert system.failed == {"deaf": -signal.SIGKILL}


def test_what_cannot_start_stops_the_rest():
    told = []
    with (
        pytest.raises(LaunchError, match="two does not start"),
        System([Process("one", python("import time; time.sleep(600)")), Process("two", ("/no/such/program",))], told.append),
    ):
        pass
    assert group_is_gone(int(told[0].split()[-1]))
