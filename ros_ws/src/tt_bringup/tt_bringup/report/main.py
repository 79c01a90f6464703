"""The command `ros2 run tt_bringup report`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tt_core.errors import TtError

from .run_page import write_report
from .run_record import RunRecord
from .words import print_run


def main() -> int:
    """Run the command line: print the report of a recording, write its page, and return the exit code."""
    parser = argparse.ArgumentParser(prog="report", description="Report what became of a recorded run: as text, and as a page.")
    parser.add_argument("bag", type=Path, help="recording of any kind")
    parser.add_argument("file", type=Path, nargs="?", help="the page; report.html beside the recording unless given")
    parser.add_argument("--text", action="store_true", help="print the text only, and write no page")
    args = parser.parse_args()
    file = args.file or args.bag.absolute().parent / "report.html"
    try:
        if args.text:
            print_run(RunRecord.read(args.bag))
            return 0
        print_run(write_report(args.bag, file))
    except (TtError, OSError) as error:
        print(f"report: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print(f"page: {file}")
    return 0
