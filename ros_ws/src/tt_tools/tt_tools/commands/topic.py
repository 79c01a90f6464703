"""The command `ros2 topic`: list, info, type, find, echo, hz, bw, delay, pub."""

from __future__ import annotations

from argparse import Namespace

from ..errors import GraphError
from .arguments import (
    Verbs,
    add_discovery,
    add_qos,
    add_topic,
    add_type,
    count,
    group,
    not_negative,
    positive,
    qos_words,
    verb,
)

TRUNCATE = 128  # elements of an array and characters of a string that `echo` prints unless told otherwise, as in ros2cli
RATE_WINDOW, BANDWIDTH_WINDOW = 10000, 100  # messages over which hz and delay, and bw, average unless told otherwise, as in ros2cli


def show_list(args: Namespace) -> None:
    """Run `ros2 topic list`: print the names of all topics."""
    from ..graph import graph, topics

    with graph(args.spin_time) as node:
        found = topics(node, hidden=args.include_hidden_topics)
        counts = {name: (node.count_publishers(name), node.count_subscribers(name)) for name in found}
    if args.count_topics:
        print(len(found))
    elif args.verbose:
        for side, title in enumerate(("publisher", "subscriber")):
            print(f"{('Published', 'Subscribed')[side]} topics:")
            for name, types in found.items():
                if n := counts[name][side]:
                    print(f" * {name} [{', '.join(types)}] {n} {title}{'s' * (n > 1)}")
            print()
    else:
        for name, types in found.items():
            print(f"{name} [{', '.join(types)}]" if args.show_types else name)


def info(args: Namespace) -> None:
    """Run `ros2 topic info`: print the type of a topic and the numbers of its publishers and subscriptions, and all of them if verbose."""
    from ..graph import appears, graph, topics

    with graph(args.spin_time) as node:
        name = node.resolve_topic_name(args.topic_name)
        if not appears(lambda: name in topics(node, hidden=True)):
            raise GraphError(f"Unknown topic '{args.topic_name}'")
        types = topics(node, hidden=True)[name]
        end = "\n\n" if args.verbose else "\n"
        print(f"Type: {types[0] if len(types) == 1 else types}", end=end)
        print(f"Publisher count: {node.count_publishers(name)}", end=end)
        for one in node.get_publishers_info_by_topic(name) if args.verbose else ():
            print(one, end=end)
        print(f"Subscription count: {node.count_subscribers(name)}", end=end)
        for one in node.get_subscriptions_info_by_topic(name) if args.verbose else ():
            print(one, end=end)


def show_type(args: Namespace) -> int:
    """Run `ros2 topic type`: print the type of a topic. Returns the exit code, 1 if there is no such topic."""
    from ..graph import graph, topics

    with graph(args.spin_time) as node:
        types = topics(node, hidden=True).get(node.resolve_topic_name(args.topic_name), [])
    print("\n".join(types), end="\n" if types else "")
    return 0 if types else 1


def find(args: Namespace) -> None:
    """Run `ros2 topic find`: print the names of the topics that have a given type."""
    from ..graph import graph, topics
    from ..packages import full_name

    with graph(args.spin_time) as node:
        found = [name for name, types in topics(node, hidden=args.include_hidden_topics).items() if full_name(args.topic_type) in types]
    print(len(found) if args.count_topics else "\n".join(found), end="\n" if found or args.count_topics else "")


def echo(args: Namespace) -> None:
    """Run `ros2 topic echo`: print the messages of a topic."""
    from ..listen import EchoOptions, echo
    from ..message_text import TextOptions

    text = TextOptions(None if args.full_length else args.truncate_length, not args.no_arr, not args.no_str, args.flow_style)
    options = EchoOptions(text, args.csv, args.field, args.raw, args.filter, args.once, args.timeout)
    echo(args.topic_name, args.message_type, qos_words(args), options)


def hz(args: Namespace) -> None:
    """Run `ros2 topic hz`: print the rate of a topic every second."""
    from ..listen import print_rate

    print_rate(args.topic_name, args.window, args.filter)


def bw(args: Namespace) -> None:
    """Run `ros2 topic bw`: print the bandwidth of a topic every second."""
    from ..listen import print_bandwidth

    print_bandwidth(args.topic_name, args.window)


def delay(args: Namespace) -> None:
    """Run `ros2 topic delay`: print every second the time from the stamp of a message to its arrival."""
    from ..listen import print_delay

    print_delay(args.topic_name, args.window)


def pub(args: Namespace) -> None:
    """Run `ros2 topic pub`: publish messages on a topic."""
    from ..publish import PubOptions, publish

    times = 1 if args.once else args.times
    wait = args.wait_matching_subscriptions if args.wait_matching_subscriptions is not None else int(times > 0)
    options = PubOptions(args.rate, times, args.print, wait, args.max_wait_time_secs, args.keep_alive, args.node_name)
    publish(args.topic_name, args.message_type, args.values, qos_words(args), options)


def add(words: Verbs) -> None:
    """Add the command `ros2 topic` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "topic", "look at topics, and publish on them")
    one = verb(verbs, "list", show_list, "name the topics")
    one.add_argument("-t", "--show-types", action="store_true", help="with their types")
    one.add_argument("-c", "--count-topics", action="store_true", help="print how many there are")
    one.add_argument("-v", "--verbose", action="store_true", help="with types and numbers of publishers and subscribers")
    one.add_argument("--include-hidden-topics", action="store_true", help="those that begin with _, too")
    add_discovery(one)
    one = verb(verbs, "info", info, "print type and counts of a topic")
    add_topic(one)
    one.add_argument("-v", "--verbose", action="store_true", help="with node, type hash and quality of service of each side")
    add_discovery(one)
    one = verb(verbs, "type", show_type, "print the type of a topic")
    add_topic(one)
    add_discovery(one)
    one = verb(verbs, "find", find, "name the topics of a type")
    add_type(one, "topic_type", "msg")
    one.add_argument("-c", "--count-topics", action="store_true", help="print how many there are")
    one.add_argument("--include-hidden-topics", action="store_true", help="those that begin with _, too")
    add_discovery(one)

    one = verb(verbs, "echo", echo, "print the messages of a topic")
    add_topic(one)
    add_type(one, "message_type", "msg", nargs="?", default="")
    one.add_argument("--csv", action="store_true", help="values separated by commas")
    one.add_argument("--field", default="", metavar="FIELD", help="a part only, e.g. twist.twist.angular or points[0].time_from_start")
    one.add_argument("-f", "--full-length", action="store_true", help="all elements of arrays and strings")
    one.add_argument("-l", "--truncate-length", type=count, default=TRUNCATE, metavar="N", help=f"elements that are printed ({TRUNCATE})")
    one.add_argument("--no-arr", action="store_true", help="type and length of arrays only")
    one.add_argument("--no-str", action="store_true", help="length of strings only")
    one.add_argument("--flow-style", action="store_true", help="YAML in flow style")
    one.add_argument("--raw", action="store_true", help="the serialized bytes")
    one.add_argument("--filter", default="", metavar="EXPR", help="those only for which a Python expression of m, the message, is true")
    one.add_argument("--once", action="store_true", help="end after the first")
    one.add_argument("--timeout", type=positive, metavar="S", help="end after a time")
    add_qos(one)

    one = verb(verbs, "hz", hz, "print the rate of a topic every second")
    add_topic(one)
    one.add_argument("-w", "--window", type=count, default=RATE_WINDOW, metavar="N", help=f"messages to average over ({RATE_WINDOW})")
    one.add_argument("--filter", default="", metavar="EXPR", help="those only for which a Python expression of m, the message, is true")
    one.add_argument("--wall-time", action="store_true", help="accepted: rates are by the clock of this machine")
    one = verb(verbs, "bw", bw, "print the bandwidth of a topic every second")
    add_topic(one)
    one.add_argument("-w", "--window", type=count, default=BANDWIDTH_WINDOW, metavar="N", help=f"messages ({BANDWIDTH_WINDOW})")
    one = verb(verbs, "delay", delay, "print every second how long after their stamps messages come")
    add_topic(one)
    one.add_argument("-w", "--window", type=count, default=RATE_WINDOW, metavar="N", help=f"messages to average over ({RATE_WINDOW})")

    one = verb(verbs, "pub", pub, "publish messages on a topic")
    add_topic(one)
    add_type(one, "message_type", "msg")
    one.add_argument("values", nargs="?", default="{}", help="in YAML, e.g. '{data: 1.0}'; auto: a header of now, now: the time")
    one.add_argument("-r", "--rate", type=positive, default=1.0, metavar="HZ", help="messages a second (1)")
    one.add_argument("-p", "--print", type=count, default=1, metavar="N", help="print every N-th message only")
    often = one.add_mutually_exclusive_group()
    often.add_argument("-1", "--once", action="store_true", help="publish one message and end")
    often.add_argument("-t", "--times", type=count, default=0, metavar="N", help="publish N messages and end")
    one.add_argument("-w", "--wait-matching-subscriptions", type=count, metavar="N", help="wait for N first; 1 with -1 and -t, else 0")
    one.add_argument("--max-wait-time-secs", type=positive, metavar="S", help="longest wait for them")
    one.add_argument("--keep-alive", type=not_negative, default=0.1, metavar="S", help="time to stay after the last message (0.1)")
    one.add_argument("-n", "--node-name", default="", help="name of the node that publishes")
    add_qos(one)
