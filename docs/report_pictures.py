"""Take the pictures of the report for the README: python docs/report_pictures.py BAG FOLDER. Needs the program chromium."""

import argparse
import sys
import tempfile
from pathlib import Path

from tt_bringup.report import write_report

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import opened

SIZES = ((1400, 1900, False), (390, 3000, True))  # pixels of a desk and of a telephone; whether it is dark
SETTLED = 3000  # ms for the page to draw


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bag", type=Path)
    parser.add_argument("folder", type=Path)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        page = Path(place) / "report.html"
        write_report(args.bag, page)
        for width, height, dark in SIZES:
            with opened(page.as_uri(), width, height, button="Play", dark=dark) as (shown, _):
                shown.wait_for_timeout(SETTLED)
                shown.screenshot(path=args.folder / f"report_{width}.png")


if __name__ == "__main__":
    main()
