"""Whether an arm would play, and where it should stand: the search, what it writes, and what is refused."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from arm.own_urdfs import SIX
from hypothesis import given
from hypothesis import strategies as st
from tt_arm.arm_file import load_arm
from tt_arm.reach import ReachFailure
from tt_arm.swing import SwingFailure
from tt_core.robots import ArmFile, read_arm
from tt_eval.arm_study import search as search_module
from tt_eval.arm_study.limiting import LIMITING, limiting
from tt_eval.arm_study.main import write_folder
from tt_eval.arm_study.placement import BASE_HIGH, BASE_LOW, Placement, changed, draw_placement
from tt_eval.arm_study.quick_score import QuickScore, quick_score
from tt_eval.arm_study.search import Candidate, OtherSearch, SearchTask, front, search_placements
from tt_eval.arm_study.speed_map import speed_map

FILE, URDF = read_arm("frame5")
needs_data = pytest.mark.skipif(not os.environ.get("TT_DATA_DIR"), reason="TT_DATA_DIR names no folder of real data")


def candidates(scores):
    return [Candidate(Placement((float(i), 0.0, 0.0, 0.0), None, None), QuickScore(*score)) for i, score in enumerate(scores)]


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=20))
def test_nothing_is_better_than_the_front_in_both(scores):
    tried = candidates(scores)
    best = front(tried)
    for one in tried:
        assert any(b.score.catapult >= one.score.catapult and b.score.rallies >= one.score.rallies for b in best)
    catapult, rallies = ([getattr(b.score, kind) for b in best] for kind in ("catapult", "rallies"))
    assert catapult == sorted(catapult) and rallies == sorted(rallies, reverse=True)


def test_drawn_and_changed_placements_are_within_their_ranges():
    rng, start = np.random.default_rng(0), Placement.of(FILE)
    arm = load_arm("frame5")
    for _ in range(20):
        one = draw_placement(start, str(URDF), FILE, ("waiting",), rng)
        assert np.all(np.array(one.base) >= BASE_LOW) and np.all(np.array(one.base) <= BASE_HIGH) and one.waiting == start.waiting
        other = changed(replace(start, mount=(0.15, 0.0)), arm.position_limits, ("base",), rng)
        assert other.base == start.base and other.mount[0] == 0.15
        low, high = arm.position_limits.T
        assert np.all(np.array(other.waiting) >= low) and np.all(np.array(other.waiting) <= high)


def test_a_drawn_waiting_posture_holds_the_racket_towards_the_opponent():
    one = draw_placement(Placement.of(FILE), str(URDF), FILE, ("base", "mount"), np.random.default_rng(1))
    position, rotation = load_arm("frame5").racket(np.array(one.waiting))
    assert position == pytest.approx([-0.45, 0.7625, 0.425], abs=1e-6) and rotation[0, 2] > 0.9


def test_every_code_of_a_refusal_says_what_limits():
    assert set(LIMITING) == {*ReachFailure, *SwingFailure}
    found = limiting([("", ""), *[("TORQUE_LIMIT", "r1")] * 2, ("OUT_OF_REACH", ""), ("NOT_CONVERGED", "")])
    assert list(found.values()) == [2, 2] and "effort of r1" in found


def test_the_map_has_what_the_joints_give():
    arm = load_arm("frame5")
    speeds = speed_map(arm, FILE.hit_window, FILE.command_timeout)
    assert speeds.speed.shape == (len(speeds.z), len(speeds.y)) and np.all(speeds.speed > 1.5)  # m/s; usual returns ask for 1.5 to 2.5
    assert sum(speeds.bounding.values()) == pytest.approx(1.0) and set(speeds.bounding) == set(arm.names)
    slow = replace(arm, limits=arm.limits.reduced(speed=0.1))
    assert np.all(speed_map(slow, FILE.hit_window, FILE.command_timeout).speed < speeds.speed)


def test_the_folder_is_the_arm(tmp_path):
    best = Candidate(Placement((0.05, 0.7, 0.0, 0.1), None, (0.1, 0.4, -0.5, 0.2, 0.0)), QuickScore(1.0, 1.0))
    write_folder(tmp_path, FILE, URDF, best)
    arm, same = load_arm(str(tmp_path)), load_arm("frame5", best.placement.base, waiting=best.placement.waiting)
    assert arm.racket(arm.waiting)[0] == pytest.approx(same.racket(same.waiting)[0], abs=1e-12)
    found, urdf = read_arm(str(tmp_path))
    assert urdf.parent == tmp_path and replace(found, urdf="", base=(), waiting=()) == replace(FILE, urdf="", base=(), waiting=())


@needs_data
def test_a_search_goes_on_where_it_was_interrupted(tmp_path):
    task, file = SearchTask(str(URDF), FILE, ("base", "mount"), count=4), tmp_path / "search.jsonl"
    done = search_placements(task, file, workers=1)
    assert len(done) == 4 and done[0].placement == Placement.of(FILE) and done[0].score.rallies > 0.9
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:3], lines[3][:40]]))  # as if it had been interrupted while it wrote the third placement
    again = search_placements(task, file, workers=1)
    assert again[:2] == done[:2] and len(again) == 4
    with pytest.raises(OtherSearch):
        search_placements(replace(task, kept=("base",)), file)


@needs_data
def test_an_arm_that_cannot_wait_where_it_should_scores_nothing():
    arm = load_arm("frame5", waiting=(0.0, 1.2, -1.1, 1.1, 0.0))  # the racket in the table
    assert quick_score(arm, FILE) == QuickScore(0.0, 0.0)


def test_what_is_no_file_of_a_search_is_refused(tmp_path):
    file = tmp_path / "search.jsonl"
    for text in ("", "nothing", json.dumps({"urdf": "other"})):
        file.write_text(text)
        with pytest.raises(OtherSearch):
            search_module.search_placements(SearchTask(str(URDF), FILE, count=1), file)


def refused(*words):
    done = subprocess.run([sys.executable, "-m", "tt_eval.arm_study.main", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    return done.stderr


def test_what_cannot_be_is_refused_with_its_reason(tmp_path):
    (tmp_path / "four.urdf").write_text(SIX.replace('type="revolute"', 'type="fixed"'))
    out = ("--out", str(tmp_path / "out"))
    assert "moving joints" in refused(str(tmp_path / "four.urdf"), "--tip", "tool0", *out)
    assert "frame5" in refused("nobody", *out)
    assert "--balls" in refused("frame5", "--balls", "0", *out)


def test_a_urdf_needs_nothing_else():
    assert ArmFile(urdf="x.urdf").tip is None
