"""The command `ros2 bag`: record, play, info, reindex, compress."""

from __future__ import annotations

import json
import os
import re
from argparse import Namespace
from datetime import datetime
from pathlib import Path
from typing import Any

from tt_core.errors import TtError

from .. import packages
from .arguments import Verbs, complete, count, group, known, not_negative, positive, renaming, verb


def record(args: Namespace) -> None:
    """Run `ros2 bag record`: replace this process by the node `record_node`, with the options as its parameters."""
    topics = [*args.topics, *args.more_topics]
    if not (topics or args.all or args.regex):
        raise TtError("Need to specify at least one option out of --all, --topics or --regex")
    wanted: dict[str, Any] = {
        "output": args.output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S"),
        "topics": [] if args.all else topics,
        "regex": "" if args.all else args.regex,
        "exclude": args.exclude_regex,
        "exclude_topics": args.exclude_topics,
        "hidden": args.include_hidden_topics,
        "compression": args.compression_format if args.compression_mode == "file" else args.compression,
        "split_bytes": args.max_bag_size,
        "split_seconds": args.max_bag_duration,
        "queue_bytes": args.max_cache_size,
    }
    parameters = [word for name, value in wanted.items() if value for word in ("-p", f"{name}:={json.dumps(value)}")]
    program = packages.executable("tt_tools", "record_node")
    os.execv(program, [str(program), "--ros-args", "-r", f"__node:={args.node_name}", *parameters])


def play(args: Namespace) -> None:
    """Run `ros2 bag play`: publish the messages of a bag."""
    from ..play_node import BagPlayParams, play_bag

    topics, bag = tuple(args.topics), args.input or args.bag
    excluded = [args.exclude_regex, *(f"^{re.escape(name)}$" for name in args.exclude_topics)]
    if bag is None:
        raise TtError("give the path of a bag")
    params = BagPlayParams(
        bag=str(bag),
        rate=args.rate,
        clock=args.clock or 0.0,
        topics=topics,
        regex=args.regex,
        exclude="|".join(filter(None, excluded)),
        position=args.start_offset,
        duration=args.playback_duration,
        loop=args.loop,
        paused=args.start_paused,
        delay=args.delay,
    )
    print(f"played {play_bag(params, dict(args.remap), keys=not args.disable_keyboard_controls)} messages")


def info(args: Namespace) -> None:
    """Run `ros2 bag info`: print the content of a bag."""
    from ..describe import describe_bag, lines

    found = describe_bag(args.bag, sizes=args.verbose)
    print("\n".join([topic.name for topic in found.topics] if args.topic_name else lines(found, args.sort)))


def reindex(args: Namespace) -> None:
    """Run `ros2 bag reindex`: make a bag readable whose recorder was killed."""
    from ..reindex import reindex

    print(reindex(args.bag))


def compress(args: Namespace) -> None:
    """Run `ros2 bag compress`: rewrite a bag with another compression."""
    from ..reindex import compress

    compress(args.bag, args.format)


def add(words: Verbs) -> None:
    """Add the command `ros2 bag` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "bag", "record topics and play them back")
    one = verb(verbs, "record", record, "record topics")
    complete(one.add_argument("topics", nargs="*"), known("topics"))
    one.add_argument("--topics", dest="more_topics", nargs="+", default=[], metavar="TOPIC")
    one.add_argument("-a", "--all", "--all-topics", action="store_true", help="all topics")
    one.add_argument("-e", "--regex", default="", metavar="REGEX", help="topics in which this is found")
    one.add_argument("-x", "--exclude-regex", default="", metavar="REGEX", help="but not those in which this is found")
    one.add_argument("--exclude-topics", nargs="+", default=[], metavar="TOPIC", help="but not these")
    one.add_argument("--include-hidden-topics", action="store_true", help="topics that begin with _, too")
    one.add_argument("-o", "--output", metavar="DIR", help="a new directory; named by the time unless given")
    one.add_argument("-s", "--storage", choices=("mcap",), default="mcap")
    one.add_argument("-b", "--max-bag-size", type=count, default=0, metavar="BYTES", help="begin the next file when one has this size")
    one.add_argument("-d", "--max-bag-duration", type=not_negative, default=0.0, metavar="S", help="begin the next file after this time")
    one.add_argument("--max-cache-size", type=count, default=0, metavar="BYTES", help="most that waits for the disk")
    one.add_argument("--compression", choices=("none", "lz4", "zstd"), default="none", help="lz4 while it records, zstd when it has ended")
    one.add_argument("--compression-mode", choices=("none", "file"), default="none", help="file: as --compression zstd")
    one.add_argument("--compression-format", choices=("zstd",), default="zstd")
    one.add_argument("--node-name", default="record", metavar="NAME")
    one = verb(verbs, "play", play, "publish what was recorded")
    one.add_argument("bag", type=Path, nargs="?", help="a bag of any kind")
    one.add_argument("-i", "--input", type=Path, metavar="BAG", help="the bag, instead of the word")
    one.add_argument("-s", "--storage", default="", help="accepted: the kind of a bag is found by its files")
    one.add_argument("-r", "--rate", type=positive, default=1.0, help="recorded seconds in a second")
    one.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="only these")
    one.add_argument("-e", "--regex", default="", metavar="REGEX", help="only topics in which this is found")
    one.add_argument("-x", "--exclude-regex", default="", metavar="REGEX", help="but not those in which this is found")
    one.add_argument("--exclude-topics", nargs="+", default=[], metavar="TOPIC", help="but not these")
    one.add_argument("-l", "--loop", action="store_true", help="begin again at the end")
    one.add_argument("-m", "--remap", nargs="+", type=renaming, default=[], metavar="OLD:=NEW")
    one.add_argument("--clock", type=positive, nargs="?", const=40.0, metavar="HZ", help="publish /clock, 40 times a second unless given")
    one.add_argument("-d", "--delay", type=not_negative, default=0.0, metavar="S", help="time to wait first")
    one.add_argument("--start-offset", type=not_negative, default=0.0, metavar="S", help="begin this long after the first message")
    one.add_argument("--playback-duration", type=not_negative, default=0.0, metavar="S", help="recorded time to play; 0: to the end")
    one.add_argument("-p", "--start-paused", action="store_true", help="begin paused")
    one.add_argument("--disable-keyboard-controls", action="store_true", help="ignore keys")
    one = verb(verbs, "info", info, "tell what a bag holds")
    one.add_argument("bag", type=Path, help="a bag of any kind")
    one.add_argument("-s", "--storage", default="", help="accepted: the kind of a bag is found by its files")
    one.add_argument("-t", "--topic-name", action="store_true", help="print the names of topics only")
    one.add_argument("-v", "--verbose", action="store_true", help="read all messages and tell what each topic takes")
    one.add_argument("--sort", choices=("name", "type", "count"), default="name", help="order of the topics")
    one = verb(verbs, "reindex", reindex, "make a bag readable whose recorder was killed")
    one.add_argument("bag", type=Path)
    one = verb(verbs, "compress", compress, "rewrite a recording with another compression")
    one.add_argument("bag", type=Path)
    one.add_argument("--format", choices=("none", "lz4", "zstd"), default="zstd")
