"""Write the page of a run: a summary, a table of the balls, and a file for each ball, which the page loads when a reader opens it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

from markupsafe import Markup
from tt_core.errors import TtError
from tt_eval.page import Section, Table, figure_data, html_page, script_call, write_page
from tt_tools.describe import attachments

from ..reprocess import all_parameters, recorded_description
from .arm_pose import ArmPose
from .ball_images import BallImages, read_ball_images
from .figures import from_above, from_the_side, joint_figures, landings, latencies, prediction_error
from .rally_scene import REPLAY_STEP, rally_scene
from .run_record import BallRecord, RunRecord
from .words import HEAD, facts, run_summary, table_row

BALLS_FOLDER = "{}_balls"  # folder of the files of the balls, beside the page whose name (without .html) is inserted
BALL_PAGER = Markup(
    '<div id="balls"><p><button id="earlier" type="button">Earlier ball</button> <button id="later" type="button">Later ball</button></p>'
    '<div id="ball"></div></div>'
)


def write_report(bag: Path, file: Path) -> RunRecord:
    """Write the page of a recording, and beside it the folder with the files of its balls and the code that draws the figures.

    Args:
        bag: The recording, a bag of any kind.
        file: Path of the page, which is overwritten.

    Returns:
        Record of the run.

    Raises:
        TtError: The bag cannot be read, or holds several robots.
        OSError: The files cannot be written.
    """
    run = RunRecord.read(bag)
    values = all_parameters(attachments(bag), [])
    arm = recorded_arm(run, values)
    folder = file.with_name(BALLS_FOLDER.format(file.stem))
    write_page(file, _page(run, folder.name))
    folder.mkdir(exist_ok=True)
    for old in folder.glob("ball_*.js"):
        old.unlink()
    for ball, images in _with_images(run.balls, read_ball_images(bag, values["estimate"])):
        (folder / f"ball_{ball.number:04d}.js").write_text(_ball_file(ball, images, run, arm))
    return run


def _page(run: RunRecord, folder: str) -> str:
    """Return the HTML of the page, which loads the files of the balls from `folder`."""
    balls = run.balls
    sections = []
    if balls:
        rows: list[list[str]] = [table_row(ball) for ball in balls]
        for cells in rows:
            cells[0] = Markup('<a href="#ball-{0}">{0}</a>').format(cells[0])
        figures = [landings(balls)] if any(ball.metrics for ball in balls) else []
        if any(ball.latencies for ball in balls):
            figures.append(latencies(balls))
        sections.append(Section("Balls", tables=[Table(HEAD, rows)], figures=figures))
        sections.append(Section("Ball by ball", html=BALL_PAGER))
    first = next((ball.number for ball in balls if ball.reason), 1)
    here = files(__package__)
    start = script_call("startReport", folder, len(balls), first) if balls else ""
    return html_page(
        f"Run of {datetime.fromtimestamp(balls[0].start):%d %B %Y, %H:%M}" if balls else "Run without a ball",
        sections,
        lead=run_summary(run),
        scripts=[(here / "report.js").read_text() + start],
        styles=[(here / "report.css").read_text()],
    )


def recorded_arm(run: RunRecord, values: Mapping[str, Mapping[str, Any]]) -> ArmPose | None:
    """Return the arm of a recording.

    Args:
        run: Record of the run, with the URDF if it was recorded.
        values: Parameter values by name, for each node. They name the arm that is used if no URDF was recorded.

    Returns:
        The arm; None if no joint states were recorded, or the arm does not have their joints or cannot be read.
    """
    if not run.joint_names:
        return None
    try:
        if run.urdf:
            return ArmPose(run.urdf, run.joint_names)
        return ArmPose(recorded_description(None, values), run.joint_names)
    except (TtError, OSError):
        return None


def _with_images(balls: Sequence[BallRecord], found: Iterable[BallImages]) -> Iterable[tuple[BallRecord, BallImages | None]]:
    """Yield each ball with the images of its last burst, or None if it has none. Both arguments are in the order of time."""
    bursts, burst = iter(found), None
    burst = next(bursts, None)
    for i, ball in enumerate(balls):
        following = balls[i + 1].start if i + 1 < len(balls) else float("inf")
        mine = None
        while burst is not None and burst.time < following:
            mine = burst if burst.time >= ball.start else mine
            burst = next(bursts, None)
        yield ball, mine


def _ball_file(ball: BallRecord, found: BallImages | None, run: RunRecord, arm: ArmPose | None) -> str:
    """Return the JavaScript file that passes the data of a ball to the page."""
    images = [{**asdict(image), "ms": 1e3 * (image.time - found.time)} for image in found.images] if found is not None else []
    figures = [from_the_side(ball), from_above(ball), prediction_error(ball), *joint_figures(ball, run, arm)]
    if ball.latencies:
        figures.append(latencies([ball]))
    strike = ball.swing.strike if ball.swing is not None else ball.start
    scene = rally_scene(ball, arm)
    content = {
        "title": ball.title,
        "reason": ball.reason,
        "facts": facts(ball),
        "words": found.words if found is not None else "",
        "images": images,
        "scene": {**scene, "strike": max(0, min(len(scene["ball"]) - 1, round((strike - ball.start) / REPLAY_STEP)))},
        "figures": [
            {"title": figure.layout.title.text, "height": figure.layout.height, "figure": json.loads(figure_data(figure))}
            for figure in figures
            if figure is not None
        ],
    }
    return script_call("reportBall", ball.number, content)
