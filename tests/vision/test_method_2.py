"""The yardstick of the latency benchmark is Method 2, and stays as it is."""

import sys
from pathlib import Path

import numpy as np
import pytest
from tt_core.constants import RPM
from tt_vision.measure import estimate_spin

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def benchmarks():
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))


def test_it_is_frozen(benchmarks, monkeypatch):
    import latency

    latency.check_frozen()
    monkeypatch.setattr(latency, "HASH", "another")
    with pytest.raises(SystemExit):
        latency.check_frozen()


def test_it_finds_what_method_2_finds(benchmarks, film):
    import method2

    shot = film(27, spin=[700.0, -800.0, 600.0])
    found = method2.method_2(shot.frames, shot.times, np.array([camera.vector for camera in shot.cameras]))
    # E (2.32) has steps, so that another rounding may end elsewhere; on the day both were the same to the last digit
    assert np.linalg.norm(found - estimate_spin(shot.frames, shot.times, shot.cameras, method="liu").spin) / RPM < 1.0
