"""Write the reference recording in every form that bags have, try every tool on it, and print the table: python docs/bag_forms.py.

The table is docs/bags.md. The program ends with 1 if a tool fails.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from tt_bringup.compare import compare
from tt_bringup.report import write_report
from tt_bringup.reprocess import reprocess
from tt_core.errors import TtError
from tt_core.ros.bags import Bag
from tt_tools.describe import describe_bag
from tt_tools.reindex import compress, reindex

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from bagforms import FORMS, Rows  # noqa: E402

REFERENCE = ROOT / "bags" / "reference_back_5"
MADE = ("/ball/measured", "/ball/path", "/racket/strokes")
IMAGES, MESSAGES = 48, 671  # of the reference
HEAD = """# Bags of every kind

Written by `python docs/bag_forms.py`: the reference recording in every form, through every tool that takes a bag. A number is what the tool
gave: messages told, messages played, images published, pages made, balls measured anew, which are bit for bit those of the reference.

| form | `ros2 bag info` | `ros2 bag play` | `camera_node` | report | `reprocess` |
|---|---|---|---|---|---|
"""


def killed(folder: Path, rows: Rows) -> Path:
    """A recording that was cut in its last chunk and has no metadata, after `ros2 bag reindex`."""
    path = FORMS["mcap"](folder, rows)
    (path / "metadata.yaml").unlink()
    (file,) = path.glob("*.mcap")
    with file.open("r+b") as stream:
        stream.truncate(file.stat().st_size - 100)
    reindex(path)
    return path


def zstd_afterwards(folder: Path, rows: Rows) -> Path:
    """A recording that `ros2 bag compress` has rewritten."""
    path = FORMS["mcap"](folder, rows)
    compress(path, "zstd")
    return path


ALL = {**FORMS, "mcap, recorder killed, after `ros2 bag reindex`": killed, "mcap, after `ros2 bag compress`": zstd_afterwards}


def info(path: Path) -> int:
    """Return how many messages a bag has."""
    return sum(topic.count for topic in describe_bag(path).topics)


def found(pattern: str, *words: str) -> int:
    """Run a command, and return the number in its output. Raises TtError if there is none."""
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, env={**os.environ, "ROS_DOMAIN_ID": "99"})
    match = re.search(pattern, done.stdout + done.stderr)
    if done.returncode or not match:
        raise TtError(f"{' '.join(words)}: exit code {done.returncode}, {done.stderr[-300:]}")
    return int(match[1])


def play(path: Path) -> int:
    """Return how many messages were played."""
    return found(r"played (\d+) messages", "ros2", "bag", "play", str(path), "--rate", "50")


def camera(path: Path) -> int:
    """Return how many images camera_node publishes."""
    options = ("kind:=bag", f"path:={path}", "wait:=0.0", "linger:=0.5", "end:=true", "speed:=0.0")
    words = [word for option in options for word in ("-p", option)]
    return found(r": (\d+) images", "ros2", "run", "tt_vision", "camera_node", "--ros-args", *words)


def report(path: Path) -> int:
    """Return how many pages are made."""
    page = Path(tempfile.mkdtemp()) / "report.html"
    write_report(path, page)
    return int("<html" in page.read_text())


def again(path: Path) -> int:
    """Return how many balls are measured anew; TtError if they are not those of the reference."""
    folder = Path(tempfile.mkdtemp())
    for name, bag in (("reference", REFERENCE), ("this", path)):
        reprocess(bag, "vision", folder / name)
    differences = [one for one in compare(folder / "reference", folder / "this") if one.topic in MADE and not one.is_equal]
    if differences:
        raise TtError("; ".join(f"{one.topic}: {one.words()}" for one in differences))
    with Bag(folder / "this") as bag:
        return len(list(bag.messages([MADE[0]])))


TOOLS: dict[Callable[[Path], int], Callable[[int], bool]] = {  # what each must give
    info: lambda n: n == MESSAGES,
    play: lambda n: n == MESSAGES,
    camera: lambda n: n == IMAGES,
    report: lambda n: n == 1,
    again: lambda n: n == 1,
}


def main() -> int:
    """Print the table and return the exit code."""
    with Bag(REFERENCE) as bag:
        rows: Rows = [(message.topic, message.kind, message.time, bag.decode(message)) for message in bag.messages()]
    lines, failed = [], False
    for name, write in ALL.items():
        with tempfile.TemporaryDirectory() as folder:
            path, cells = write(Path(folder), rows), []
            for tool, is_right in TOOLS.items():
                try:
                    number = tool(path)
                    cells.append(str(number) if is_right(number) else f"**{number}**")
                    failed = failed or not is_right(number)
                except TtError as error:
                    print(f"{name}: {tool.__name__}: {error}", file=sys.stderr)
                    cells.append("**failed**")
                    failed = True
        lines.append(f"| {name} | {' | '.join(cells)} |\n")
        print(lines[-1], end="", file=sys.stderr, flush=True)
    print(HEAD + "".join(lines), end="")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
