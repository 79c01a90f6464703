"""Run an experiment: ros2 run tt_eval experiment rotation|catapult|robustness [--runs N] [--out DIRECTORY]."""

from __future__ import annotations

import argparse
from pathlib import Path

from tt_vision.rig import high_speed_pair
from tt_vision.warm import warm

from ..page import Section, html_page, write_page
from . import catapult, robustness, rotation

EXPERIMENTS = {"rotation": rotation, "catapult": catapult, "robustness": robustness}


def main() -> None:
    """Run the command experiment."""
    parser = argparse.ArgumentParser(prog="experiment", description=__doc__)
    parser.add_argument("name", choices=EXPERIMENTS)
    parser.add_argument("--runs", type=int, default=10, help="bursts for each row (default 10)")
    parser.add_argument("--out", type=Path, default=Path("out"), help="directory of the figures (default out)")
    args = parser.parse_args()
    if args.runs < 1:
        parser.error(f"--runs {args.runs} is not positive")
    args.out.mkdir(parents=True, exist_ok=True)
    warm(high_speed_pair())
    figures = EXPERIMENTS[args.name].run(args.runs)
    path = args.out / f"{args.name}.html"
    write_page(path, html_page(f"Experiment: {args.name}", [Section(figures=figures)]))
    print(f"figures: {path}")


if __name__ == "__main__":
    main()
