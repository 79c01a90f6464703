"""The verbs of ros2cli that this project uses, for machines without it: run, launch, bag, topic, service, param, node, interface, pkg."""

from __future__ import annotations

import argparse
import os
import sys

from tt_core.errors import TtError

from .commands import bag, interface, launch, node, param, pkg, run, service, topic

WORDS = (run, launch, bag, topic, service, param, node, interface, pkg)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the `ros2` command line."""
    top = argparse.ArgumentParser(prog="ros2", description=__doc__)
    words = top.add_subparsers(metavar="WORD", required=True)
    for word in WORDS:
        word.add(words)
    return top


def main(words: list[str] | None = None) -> int:
    """Run one `ros2` command and return its exit code. words: the command line after "ros2"; that of this process if None."""
    made = parser()
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(made, always_complete_options="long")
    args = made.parse_args(words)
    try:
        return args.act(args) or 0
    except TtError as error:
        print(error, file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader of our output has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
