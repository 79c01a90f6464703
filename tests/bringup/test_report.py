"""The report of the reference recording, of runs with faults, and its page in a browser."""

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, opened
from rich.console import Console
from tt_arm.model import ArmModel
from tt_bringup.report import write_report
from tt_bringup.report.ball_images import read_ball_images
from tt_bringup.report.run_page import recorded_arm
from tt_bringup.report.run_record import RunRecord
from tt_bringup.report.words import TEXT_WIDTH, facts, print_run, run_summary
from tt_bringup.reprocess import all_parameters
from tt_core.constants import RPM
from tt_core.ros.bags import BagError

REFERENCE = Path(__file__).parents[2] / "bags" / "reference_back_5"
SMALL = 1_500_000  # bytes, that a page may have


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """(run, page) of the reference recording, in a folder with a space."""
    page = tmp_path_factory.mktemp("a report") / "report.html"
    return write_report(REFERENCE, page), page


def ball_file(page, number=1):
    """What the file of a ball gives to the page."""
    text = (page.parent / "report_balls" / f"ball_{number:04d}.js").read_text()
    return json.loads(re.fullmatch(r"reportBall\(\d+, (.*)\);\n", text, re.DOTALL)[1])


def test_the_run_is_its_balls():
    run = RunRecord.read(REFERENCE)
    (ball,) = run.balls
    assert ball.measured is not None and ball.path is not None and len(ball.truth) > 100
    # rpm; 24 at most in 1,000 bursts
    assert np.linalg.norm(ball.measured.spin - ball.metrics.spin_true) / RPM < 30.0


def test_images_show_the_ball_where_it_was_measured():
    (burst,) = read_ball_images(REFERENCE, {})
    assert {image.camera for image in burst.images} == {"left", "right"} and len(burst.images) == 12
    for image in burst.images:
        assert image.off < 0.5  # pixels; 0.1 to 0.3 are usual
        assert image.outline and image.edges and image.equator


def test_page_and_balls_are_small_and_name_everything_in_words(report):
    _, page = report
    assert page.stat().st_size < SMALL
    ball = ball_file(page)
    assert all((file.stat().st_size < SMALL) for file in (page.parent / "report_balls").iterdir())
    assert len(ball["images"]) == 12 and ball["facts"] and ball["figures"] and ball["words"].startswith("Measured from")
    assert len(ball["scene"]["ball"]) > 10 and len(ball["scene"]["true"]) > 10
    assert not re.search(r"speed_true|hit_error_m|_rpm\b", page.read_text() + str(ball["facts"]))


def test_the_text_has_80_columns(report):
    run, _ = report
    out = io.StringIO()
    print_run(run, Console(file=out, width=200))
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= TEXT_WIDTH
    assert "rpm" in out.getvalue() and run_summary(run)[0].split()[0] in lines[0]
    assert dict(facts(run.balls[0]))["measured spin"].endswith(")")


def test_a_new_report_leaves_no_ball_of_an_old_one(report, tmp_path):
    (tmp_path / "report_balls").mkdir()
    (tmp_path / "report_balls" / "ball_0007.js").write_text("old")
    write_report(REFERENCE, tmp_path / "report.html")
    assert [file.name for file in (tmp_path / "report_balls").iterdir()] == ["ball_0001.js"]


def test_an_arm_whose_description_was_not_recorded_is_that_of_the_parameters():
    model = ArmModel.pa10()
    arm = recorded_arm(RunRecord(REFERENCE, [], model.names, ""), all_parameters({}, []))
    line, middle, rotation = arm.at(model.waiting)
    position, face = model.racket(model.waiting)
    assert middle == pytest.approx(position, abs=1e-9) and rotation == pytest.approx(face, abs=1e-9)
    assert len(line) == len(model.names) + 1
    assert arm.speed_limits == pytest.approx(model.speed_limits)
    assert recorded_arm(RunRecord(REFERENCE, [], ["no joint of it"], ""), all_parameters({}, [])) is None


def test_no_bag_is_refused(tmp_path):
    with pytest.raises(BagError):
        write_report(tmp_path / "nothing", tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(CHROMIUM is None, reason="there is no program chromium; install it: apt-get install chromium")
def test_the_page_in_a_browser(report):
    """From file://, without errors: no wider than a desk or a telephone, dark when the system is, and the rally plays."""
    _, page = report
    with opened(page.as_uri(), 1400, button="Play") as (shown, errors):
        assert shown.locator(".js-plotly-plot").count() >= 4
        for width, scheme in ((1400, "light"), (390, "dark")):
            shown.set_viewport_size({"width": width, "height": 900})
            shown.emulate_media(color_scheme=scheme)
            shown.wait_for_function(f"document.scrollingElement.scrollWidth <= {width}")  # figures follow the window after a moment
            background = shown.evaluate("getComputedStyle(document.body).backgroundColor")
            assert (background == "rgb(255, 255, 255)") is (scheme == "light")
        shown.locator("#step").fill("0")
        shown.get_by_role("button", name="Play").click()
        shown.wait_for_function("Number(document.getElementById('step').value) > 3")
        assert not errors
