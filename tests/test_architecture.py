"""The rules that keep the house in order (ARCHITECTURE.md), held."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

SRC = Path(__file__).parents[1] / "ros_ws" / "src"
PACKAGES = sorted(p.name for p in SRC.iterdir() if p.is_dir())
FILES = sorted(SRC.glob("tt_*/tt_*/**/*.py"))
MODELS = {  # what the simulator may use of the packages that it tests: models of cameras and arm, no method
    "tt_vision.camera",
    "tt_vision.projection",
    "tt_vision.rig",
    "tt_arm.arm_file",
    "tt_arm.joints",
    "tt_arm.kinematics",
    "tt_arm.model",
    "tt_arm.safety.clearance",
}
MESSAGES = ("rosgraph", "sensor", "nav", "geometry", "std", "trajectory", "diagnostic", "visualization")
ROS = {"rclpy", "std_srvs", *(f"{name}_msgs" for name in MESSAGES)}


@cache
def parsed(path):
    """The syntax tree of a file, which several tests walk through."""
    return ast.parse(path.read_text())


def modules(path):
    """Full names of all modules of other packages that a file imports, wherever in it."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module


def imports(path):
    """Top-level names of all modules that a file imports."""
    return {name.split(".")[0] for name in modules(path)}


def relative(path):
    return path.relative_to(SRC).as_posix()


def test_there_is_something_to_check():
    assert {"tt_core", "tt_vision", "tt_predict", "tt_racket", "tt_arm", "tt_sim", "tt_eval", "tt_tools", "tt_bringup"} <= set(PACKAGES)
    assert len(FILES) > 30


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_a_package_imports_the_vocabulary_and_no_sibling(path):
    package = path.relative_to(SRC).parts[0]
    siblings = {name for name in modules(path) if name.split(".")[0] in set(PACKAGES) - {package, "tt_core"}}
    if package == "tt_sim":
        assert siblings <= MODELS
    elif package == "tt_eval":
        assert not {name for name in siblings if name.startswith(("tt_tools", "tt_bringup"))}
    elif package != "tt_bringup":
        assert not siblings


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_ros_is_known_to_nodes_only(path):
    names = "demo", "parameters", "reprocess", "robot_state_publisher", "stages", "view/scene_inputs"
    others = {*(f"tt_bringup/tt_bringup/{name}.py" for name in names), "tt_vision/tt_vision/wide_inputs.py"}
    is_ros = path.name.endswith("_node.py") or relative(path).startswith(("tt_core/tt_core/ros/", "tt_tools/")) or relative(path) in others
    assert is_ros or not imports(path) & ROS


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_the_truth_is_known_to_the_simulator_only(path):
    """No node of the robot reads sim/*. The recorder takes every topic without naming any; report and view only show the truth."""
    shown = "tt_bringup/tt_bringup/report/run_record.py", "tt_bringup/tt_bringup/view_node.py"
    if relative(path).startswith("tt_sim/") or relative(path) in shown:
        return
    strings = {n.value for n in ast.walk(parsed(path)) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    assert not any(text.startswith(("/sim/", "sim/")) for text in strings)


def test_launch_files_remap_no_truth_to_the_robot():
    for path in SRC.glob("tt_*/launch/*.yaml"):
        assert "/sim/" not in path.read_text(), path


@pytest.mark.parametrize("path", [p for p in FILES if p.name.endswith("_node.py")], ids=relative)
def test_a_node_has_an_executable(path):
    package = path.relative_to(SRC).parts[0]
    assert any(f'start("{package}.{path.stem}")' in script.read_text() for script in (SRC / package / "scripts").iterdir())


@pytest.mark.parametrize("path", [*FILES, *SRC.glob("tt_*/launch/*.yaml")], ids=relative)
def test_every_file_says_what_it_is(path):
    is_told = path.read_text().startswith("#") if path.suffix == ".yaml" else ast.get_docstring(parsed(path))
    assert is_told, f"{path} has no first line about itself"


REASONS = {"reason", "reasons", "why", "failure", "failures", "error", "sentence", "trouble", "cause", "message", "messages"}
TEXTS = {"errors", "text", "texts", "words", "told", "line", "lines", "printed", "output", "stderr", "stdout", "err", "out"}
PASSED_ON = {"read", "read_text", "readouterr", "splitlines", "strip", "lower"}  # calls whose result is a text as what they are called on
SEARCHES = {"startswith", "endswith", "count", "find", "index", "split"}
PATTERNS = {"search", "match", "fullmatch", "findall"}
SENTENCE = re.compile(r"[A-Za-z]+,? [A-Za-z]+")
TEXT_IS_SUBJECT = {  # tests of a format of text
    "tests/tools/test_launch.py",  # lines that `launch` tells of its processes
    "tests/nodes/test_life.py::started",  # the same
    "tests/nodes/test_ros2_command.py",  # what `ros2` prints, as in ROS 2
    "tests/tools/test_record.py::test_a_description_tells_size_and_counts",  # what `ros2 bag info` prints
}


def is_named(node, names):
    """Whether an expression is called one of `names`: a name, an attribute, an element or a part of one, or str() of one."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "str" and node.args:
        return is_named(node.args[0], names)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in PASSED_ON:
        return is_named(node.func.value, names)
    if isinstance(node, ast.Subscript):
        return is_named(node.value, names)
    if isinstance(node, ast.Attribute) and node.attr == "value":  # of pytest.raises
        return False
    return (node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else None) in names


def is_text(node):
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def is_sentence(node):
    """Whether an expression is a literal with words."""
    parts = [part.value if isinstance(part, ast.Constant) else "0" for part in getattr(node, "values", [node])] if is_text(node) else []
    return bool(SENTENCE.search("".join(parts)))


def is_worded(one, other):
    """Whether one expression is a reason and the other a text, or one a text and the other a sentence."""
    return (is_named(one, REASONS) and is_text(other)) or (is_named(one, REASONS | TEXTS) and is_sentence(other))


def decides_on_words(tree):
    """Nodes at which a reason is compared with a text, searched, or matched by its wording, or a text with a sentence."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            one, other = node.left, node.comparators[0]
            within = isinstance(node.ops[0], ast.In | ast.NotIn) and all(is_named(side, REASONS | TEXTS) for side in (one, other))
            if within or is_worded(one, other) or is_worded(other, one):
                yield node
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            name, arguments = node.func.attr, node.args
            matched = name == "raises" and any(keyword.arg == "match" for keyword in node.keywords)
            searched = name in SEARCHES and any(is_worded(node.func.value, one) for one in arguments)
            found = name in PATTERNS and len(arguments) > 1 and is_worded(arguments[1], arguments[0])
            if matched or searched or found:
                yield node


def exempt(path, tree):
    """The nodes of tests whose subject is a text."""
    if path in TEXT_IS_SUBJECT:
        return set(ast.walk(tree))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and f"{path}::{node.name}" in TEXT_IS_SUBJECT]
    return {node for function in functions for node in ast.walk(function)}


TESTS = sorted((SRC.parents[1] / "tests").rglob("*.py"))


@pytest.mark.parametrize("path", [*FILES, *TESTS], ids=lambda path: path.relative_to(SRC.parents[1]).as_posix())
def test_nothing_decides_on_the_words_of_a_reason(path):
    tree = parsed(path)
    known = exempt(path.relative_to(SRC.parents[1]).as_posix(), tree)
    assert not [node.lineno for node in decides_on_words(tree) if node not in known]


def test_deciding_on_words_is_seen():
    for bad in (
        '"too soon" in choice.reason',
        'reason.startswith("arm")',
        'str(why) == "late"',
        'pytest.raises(E, match="a")',
        'status.message == "swing"',
        'state.trouble.startswith("the disk")',
        "any(words in text for _, _, text, _ in statuses)",
        '"frames = 2 is outside [3, 10]" in node.stderr.read()',
        'f"{n} balls are late" in capsys.readouterr().out',
        're.search("is full", printed)',
    ):
        assert list(decides_on_words(ast.parse(bad))), bad
    for good in (
        "choice.reason.code is Code.TOO_SOON",
        'status.values["code"] == "FULL"',
        '"Traceback" not in node.stderr',
        "str(path) in done.stderr",
        'message.header.frame_id == "table"',
    ):
        assert not list(decides_on_words(ast.parse(good))), good


STAGES = {  # of the measurement, in their order; `measure` and `first_estimate` call them
    *("detect_balls", "whole_balls", "fit_motion", "cut_out_halved", "propose", "register", "cut_surface"),
    *("register_marks", "relight", "register_again", "limb_outlines", "refit_motion", "softened", "register_residual"),
    *("refine_distance", "with_near_rivals", "estimate_from"),
}


@pytest.mark.parametrize("path", sorted((SRC / "tt_vision" / "tt_vision").rglob("*.py")), ids=relative)
def test_a_stage_of_the_measurement_calls_no_other(path):
    calls = {ast.unparse(node.func) for node in ast.walk(parsed(path)) if isinstance(node, ast.Call)}
    if path.name == "measure.py":
        assert len(calls & STAGES) > 8
    elif path.name != "first_estimate.py":
        assert not calls & STAGES


def parameters(node):
    return [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_no_function_takes_more_than_eight_parameters(path):
    functions = [node for node in ast.walk(parsed(path)) if isinstance(node, ast.FunctionDef)]
    many = {f"{f.name}:{f.lineno}" for f in functions if len([p for p in parameters(f) if p.arg not in ("self", "cls")]) > 8}
    assert not many
