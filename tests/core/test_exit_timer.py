"""A process ends by the signal that it set for itself, unless it has ended before."""

import signal
import subprocess
import sys

import pytest

HANGS = "ctypes.PyDLL(None).sleep(100)"  # holds the global interpreter lock (GIL), so that no other Python thread runs


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("seconds, then, ended", [(0.3, HANGS, True), (60.0, "sys.exit(3)", False)])
def test_it_ends_by_the_signal_or_by_itself(number, seconds, then, ended):
    code = f"import ctypes, sys; from tt_core.exit_timer import end_by_signal; end_by_signal({int(number)}, {seconds}); {then}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50)
    assert done.returncode == (-number if ended else 3)
    assert not done.stderr
