"""ros2 bag: record, play, info, reindex."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from datetime import datetime
from pathlib import Path

from tt_core.errors import TtError

from .. import packages
from .arguments import Verbs, group, positive, renaming, verb


def record(args: Namespace) -> None:
    """Replace this process by the recorder."""
    topics = [*args.topics, *args.more_topics]
    if bool(topics) == args.all:
        raise TtError("give either topics or -a")
    output = args.output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    wanted = {"output": output, "topics": topics, "exclude": args.exclude_regex}
    parameters = [word for name, value in wanted.items() if value for word in ("-p", f"{name}:={json.dumps(value)}")]
    program = packages.executable("tt_tools", "record_node")
    os.execv(program, [str(program), "--ros-args", *parameters])


def play(args: Namespace) -> None:
    """Publish what a bag holds."""
    from ..play_node import PlayParams, play

    params = PlayParams(str(args.bag), args.rate, args.clock or 0.0, tuple(args.topics), args.delay)
    print(f"played {play(params, dict(args.remap))} messages")


def info(args: Namespace) -> None:
    """Print what a bag holds."""
    import sys

    from rich.console import Console

    from ..reindex import describe

    Console(width=None if sys.stdout.isatty() else 160).print(describe(args.bag))


def reindex(args: Namespace) -> None:
    """Make a bag readable whose recorder was killed."""
    from ..reindex import reindex

    print(reindex(args.bag))


def add(words: Verbs) -> None:
    """Add the word and its verbs."""
    verbs = group(words, "bag", "record topics and play them back")
    one = verb(verbs, "record", record, "record topics")
    one.add_argument("topics", nargs="*")
    one.add_argument("--topics", dest="more_topics", nargs="+", default=[], metavar="TOPIC")
    one.add_argument("-a", "--all", action="store_true", help="all topics")
    one.add_argument("--exclude-regex", default="", metavar="REGEX", help="but not those in which this is found")
    one.add_argument("-o", "--output", metavar="DIR", help="a new directory; named by the time unless given")
    one = verb(verbs, "play", play, "publish what was recorded")
    one.add_argument("bag", type=Path)
    one.add_argument("-r", "--rate", type=positive, default=1.0, help="recorded seconds in a second")
    one.add_argument("--clock", type=positive, nargs="?", const=40.0, metavar="HZ", help="publish /clock, 40 times a second unless given")
    one.add_argument("-d", "--delay", type=positive, default=0.0, metavar="S", help="seconds to wait first")
    one.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="only these")
    one.add_argument("-m", "--remap", nargs="+", type=renaming, default=[], metavar="OLD:=NEW")
    one = verb(verbs, "info", info, "tell what a bag holds")
    one.add_argument("bag", type=Path)
    one = verb(verbs, "reindex", reindex, "make a bag readable whose recorder was killed")
    one.add_argument("bag", type=Path)
