"""The words of the command line."""

import pytest
from tt_tools import packages, ros2
from tt_tools.packages import NotFound

INDEX = "share/ament_index/resource_index/packages/tt_bringup"


@pytest.mark.parametrize(
    "words, expected",
    [
        ("run tt_sim sim_node --ros-args -p seed:=1", {"executable": "sim_node", "args": ["--ros-args", "-p", "seed:=1"]}),
        ("launch tt_bringup sim.launch.yaml rtf:=0.5", {"package_or_path": "tt_bringup", "rest": ["sim.launch.yaml", "rtf:=0.5"]}),
        ("bag record -a -o out", {"all": True, "output": "out", "topics": []}),
        ("bag record /a /b -o out", {"all": False, "topics": ["/a", "/b"]}),
        ("bag play bag --clock", {"clock": 40.0, "rate": 1.0}),
        ("bag play bag --clock 500 --rate 2 --topics /a /b", {"clock": 500.0, "rate": 2.0, "topics": ["/a", "/b"]}),
        ("bag play bag -m /a:=/b", {"clock": None, "remap": [("/a", "/b")]}),
        ("topic hz /a -w 10", {"topic": "/a", "window": 10}),
    ],
)
def test_words_are_understood(words, expected):
    args = vars(ros2.parser().parse_args(words.split()))
    assert {name: args[name] for name in expected} == expected


@pytest.mark.parametrize(
    "words, reason",
    [
        ("fly", "invalid choice: 'fly' (choose from"),
        ("bag rewind", "invalid choice: 'rewind' (choose from"),
        ("bag play bag --rate 0", "0 is not positive"),
        ("bag play bag -m /a", "/a is not OLD:=NEW"),
    ],
)
def test_wrong_words_name_the_choices(words, reason, capsys):
    with pytest.raises(SystemExit, match="2"):
        ros2.main(words.split())
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, reason",
    [
        ("launch no/such.launch.yaml", "no launch file no/such.launch.yaml"),
        ("run tt_brinup x", "no package 'tt_brinup'; there is tt_bringup"),
        ("bag record", "give either topics or -a"),
        ("bag info /no/such", "there is no file or folder"),
        ("bag reindex /no/such", "there is no file or folder"),
    ],
)
def test_what_is_not_there_is_told_in_one_line(words, reason, capsys, prefix):
    assert ros2.main(words.split()) == 1
    told = capsys.readouterr().err
    assert reason in told and told.count("\n") == 1


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
    with pytest.raises(NotFound, match="no executable in tt_bringup 'some'; there is some_node"):
        packages.executable("tt_bringup", "some")
    with pytest.raises(NotFound, match=r"there is some\.launch\.yaml"):
        packages.launch_file("tt_bringup", "sim.launch.yaml")


@pytest.mark.parametrize("name", ["no_msgs/msg/Such", "std_srvs/srv/Trigge", "Trigger", ""])
def test_an_unknown_type_is_told(name):
    with pytest.raises(NotFound, match="no message or service type"):
        packages.interface(name)
