"""Launches from a process of its own: all images of a ball in the order of their arrival, the same again by their seed, and an end."""

import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest
from tt_sim.faults import CameraFaults
from tt_sim.studio import Crew, Studio


@pytest.fixture
def hire():
    """hire(studio): a crew that goes home after the test."""
    crews = []

    def hire(studio):
        crews.append(Crew(studio))
        return crews[-1]

    yield hire
    for crew in crews:
        crew.close()


def test_a_take_is_a_ball_and_its_images(hire):
    studio = Studio(seed=3, faults=CameraFaults(latency=0.004, jitter=5e-4))
    one, other = (hire(studio).take("back", 4) for _ in range(2))
    assert len(one.shown) > 30
    assert {shown.side for shown in one.shown} == {0, 1}
    due = np.array([shown.due for shown in one.shown])
    assert (np.diff(due) >= 0.0).all() and due == pytest.approx([shown.stamp + 0.004 for shown in one.shown])
    assert one.ball.vector == pytest.approx(other.ball.vector, abs=0.0)
    assert all((a.image == b.image).all() for a, b in zip(one.shown, other.shown, strict=True))


def test_a_closed_crew_takes_no_more(hire):
    crew, takes = hire(Studio()), []
    waiting = threading.Thread(target=lambda: takes.append(crew.take("top", 3)))
    waiting.start()
    time.sleep(0.1)
    crew.close()
    waiting.join(10.0)
    assert takes == [None]  # 0.1 s is less than Python takes to start there
    assert crew.take("top", 3) is None


def test_a_crew_that_has_ended_is_told(hire):
    crew = hire(Studio())
    (process,) = psutil.Process().children()
    process.kill()
    with pytest.raises(EOFError, match="has ended"):
        crew.take("top", 3)


def test_a_crew_ends_with_whoever_has_hired_it():
    """Killed, while it renders or still starts; without a word on stderr."""
    hirer = "from tt_sim.studio import Crew, Studio\ncrew = Crew(Studio())\nprint(crew._process.pid, flush=True)\ncrew.take('top', 3)"
    with subprocess.Popen([sys.executable, "-c", hirer], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        crew = psutil.Process(int(process.stdout.readline()))
        process.kill()
        assert process.stderr.read() == ""  # its end: the crew holds it open as long as it lives
    crew.wait(5.0)
