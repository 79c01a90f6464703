"""Launches from a process of its own: all images of a ball in the order of their arrival, the same again by their seed, and an end."""

import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest
from tt_sim.cameras.camera_faults import CameraFaults
from tt_sim.cameras.render_worker import LaunchRenderer, RenderWorker


@pytest.fixture
def hire():
    """hire(renderer): a worker that is closed after the test."""
    workers = []

    def hire(renderer):
        workers.append(RenderWorker(renderer))
        return workers[-1]

    yield hire
    for worker in workers:
        worker.close()


def test_a_launch_is_a_ball_and_its_images(hire):
    renderer = LaunchRenderer(seed=3, faults=CameraFaults(latency=0.004, jitter=5e-4))
    one, other = (hire(renderer).render("back", 4) for _ in range(2))
    assert len(one.images) > 30
    assert {image.side for image in one.images} == {0, 1}
    due = np.array([image.due for image in one.images])
    assert (np.diff(due) >= 0.0).all() and due == pytest.approx([image.stamp + 0.004 for image in one.images])
    assert one.ball.vector == pytest.approx(other.ball.vector, abs=0.0)
    assert all((a.image == b.image).all() for a, b in zip(one.images, other.images, strict=True))


def test_a_closed_worker_renders_no_more(hire):
    worker, launches = hire(LaunchRenderer()), []
    waiting = threading.Thread(target=lambda: launches.append(worker.render("top", 3)))
    waiting.start()
    time.sleep(0.1)
    worker.close()
    waiting.join(10.0)
    assert launches == [None]  # 0.1 s is less than Python takes to start there
    assert worker.render("top", 3) is None


def test_a_library_that_prints_does_not_disturb(hire, monkeypatch):
    monkeypatch.setenv("NUMBA_DEBUG_CACHE", "1")  # numba prints a line for each function that it loads
    assert hire(LaunchRenderer()).render("top", 3).images


def test_a_worker_that_has_ended_is_told(hire):
    worker = hire(LaunchRenderer())
    worker._process.kill()
    with pytest.raises(EOFError):
        worker.render("top", 3)


def test_the_worker_ends_with_the_process_that_started_it():
    """Killed, while it renders or still starts; without a word on stderr."""
    starter = (
        "from tt_sim.cameras.render_worker import LaunchRenderer, RenderWorker\n"
        "worker = RenderWorker(LaunchRenderer())\n"
        "print(worker._process.pid, flush=True)\n"
        "worker.render('top', 3)"
    )
    with subprocess.Popen([sys.executable, "-c", starter], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        worker = psutil.Process(int(process.stdout.readline()))
        process.kill()
        assert process.stderr.read() == ""  # its end: the worker holds it open as long as it lives
    worker.wait(5.0)
