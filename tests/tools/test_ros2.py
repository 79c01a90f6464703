"""The words of the command line."""

import shlex
from pathlib import Path

import pytest
from refusals import refused
from tt_tools import packages, ros2
from tt_tools.packages import NotFound

INDEX = "share/ament_index/resource_index/packages/tt_bringup"


@pytest.mark.parametrize(
    "words, expected",
    [
        ("run tt_sim sim_node --ros-args -p seed:=1", {"executable_name": "sim_node", "argv": ["--ros-args", "-p", "seed:=1"]}),
        ("launch tt_bringup sim.launch.yaml rtf:=0.5", {"package_name": "tt_bringup", "rest": ["sim.launch.yaml", "rtf:=0.5"]}),
        ("bag record -a -o out", {"all": True, "output": "out", "topics": []}),
        ("bag record /a /b -o out", {"all": False, "topics": ["/a", "/b"]}),
        ("bag play bag --clock", {"clock": 40.0, "rate": 1.0}),
        ("bag play bag --clock 500 --rate 2 --topics /a /b", {"clock": 500.0, "rate": 2.0, "topics": ["/a", "/b"]}),
        ("bag play bag -m /a:=/b", {"clock": None, "remap": [("/a", "/b")]}),
        ("bag play -i bag --loop --start-offset 2.5 --start-paused", {"bag": None, "input": Path("bag"), "start_offset": 2.5}),
        ("bag record -s mcap -e ball -d 10 -b 1000000", {"regex": "ball", "max_bag_duration": 10.0, "max_bag_size": 1000000}),
        ("bag info -s mcap -v bag", {"verbose": True, "bag": Path("bag")}),
        ("topic hz /a -w 10", {"topic_name": "/a", "window": 10}),
        ("run --prefix 'nice -n 5' tt_sim sim_node", {"prefix": "nice -n 5", "executable_name": "sim_node"}),
        ("topic echo /a --field x[0].y --csv --no-arr --once", {"field": "x[0].y", "csv": True, "no_arr": True, "once": True}),
        ("topic echo /a std_msgs/msg/String --qos-reliability best_effort", {"message_type": "std_msgs/msg/String"}),
        ("topic pub -1 /a std_msgs/msg/String '{data: x}'", {"once": True, "values": "{data: x}"}),
        ("param list --param-type", {"node_name": None, "param_type": True}),
        ("pkg executables", {"package_name": None}),
    ],
)
def test_words_are_understood(words, expected):
    args = vars(ros2.parser().parse_args(shlex.split(words)))
    assert {name: args[name] for name in expected} == expected


@pytest.mark.parametrize(
    "words, named",
    [
        ("fly", "fly"),
        ("bag rewind", "rewind"),
        ("bag play bag --rate 0", "0"),
        ("bag play bag -m /a", "/a"),
    ],
)
def test_wrong_words_name_the_choices(words, named, capsys):
    with refused(SystemExit, 2):
        ros2.main(words.split())
    assert named in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, named",
    [
        ("launch no/such.launch.yaml", "no/such.launch.yaml"),
        ("run tt_brinup x", "tt_brinup"),
        ("bag record", "--all"),
        ("bag info /no/such", "/no/such"),
        ("bag reindex /no/such", "/no/such"),
        ("interface show std_msgs/msg/Sting", "std_msgs/msg/Sting"),
        ("interface show nonsense", "nonsense"),
        ("pkg prefix tt_brinup", "tt_bringup"),
        ("launch tt_bringup some.launch.yaml what", "what"),
    ],
)
def test_what_is_not_there_is_told_in_one_line(words, named, capsys, prefix):
    assert ros2.main(words.split()) == 1
    printed = capsys.readouterr().err
    assert named in printed and printed.count("\n") == 1


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """An installed package tt_bringup with one executable and one launch file."""
    for path in ("lib/tt_bringup/some_node", "share/tt_bringup/launch/some.launch.yaml", INDEX):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).touch(mode=0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def test_packages_are_found_by_the_ament_index(prefix):
    assert packages.executable("tt_bringup", "some_node") == prefix / "lib/tt_bringup/some_node"
    assert packages.launch_file("tt_bringup", "some.launch.yaml") == prefix / "share/tt_bringup/launch/some.launch.yaml"
    with refused(NotFound, "tt_bringup", "some", "some_node"):
        packages.executable("tt_bringup", "some")
    with refused(NotFound, "sim.launch.yaml", "some.launch.yaml"):
        packages.launch_file("tt_bringup", "sim.launch.yaml")


@pytest.mark.parametrize("name", ["no_msgs/msg/Such", "std_srvs/srv/Trigge", "Trigger", ""])
def test_an_unknown_type_is_told(name):
    with refused(NotFound, name):
        packages.interface(name)
