"""Take the pictures of the report, and the animation of its rally, for the README: python docs/report_pictures.py BAG FOLDER.

BAG is the recording of a demo. Needs the program chromium.
"""

import argparse
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image
from tt_bringup.report import write_report

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import opened

SIZES = ((1400, 2000, False), (390, 2600, True))  # pixels of a desk and of a telephone; whether it is dark
ANIMATED = (760, 900)  # pixels of the page whose 3D scene is animated
STRIDE = 2  # steps of the scene, 0.02 s each, from one picture to the next
SHOWN = 80  # ms for which a picture is shown: half speed
COLOURS = 48
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
        with opened(page.as_uri(), *ANIMATED, button="Play") as (shown, _):
            shown.wait_for_timeout(SETTLED)
            animate(shown, args.folder / "rally.gif")


def animate(page, file: Path) -> None:
    """Write the rally of the shown ball as an animated GIF."""
    scene, slider = page.locator("#rally"), page.locator("#step")
    scene.scroll_into_view_if_needed()
    pictures = []
    for step in range(0, int(slider.get_attribute("max")), STRIDE):
        slider.fill(str(step))
        page.wait_for_timeout(60)
        pictures.append(Image.open(io.BytesIO(scene.screenshot())).convert("RGB").quantize(COLOURS))
    pictures[0].save(file, save_all=True, append_images=pictures[1:], duration=SHOWN, loop=0, optimize=True)


if __name__ == "__main__":
    main()
