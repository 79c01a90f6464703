"""Limit for the time that a process takes to end."""

from __future__ import annotations

import ctypes
import signal
import sys


class _Event(ctypes.Structure):
    """`struct sigevent` of Linux, 64 bytes: which signal a timer sends."""

    _fields_ = (("value", ctypes.c_void_p), ("signal", ctypes.c_int), ("notify", ctypes.c_int), ("rest", ctypes.c_byte * 48))


class _Times(ctypes.Structure):
    """`struct itimerspec` of Linux: the period of a timer, 0 for a single signal, and the delay of its first signal, each in s and ns."""

    _fields_ = (("period", ctypes.c_long), ("period_ns", ctypes.c_long), ("delay", ctypes.c_long), ("delay_ns", ctypes.c_long))


def end_by_signal(number: int, seconds: float) -> None:
    """End this process by a signal after some seconds, unless it has ended by itself before.

    A timer of the Linux kernel sends the signal, so that this also works while a thread holds the global interpreter lock (GIL) forever. On
    other systems than Linux this function does nothing.

    Args:
        number: The signal. From now on it ends the process at once, without Python's handler.
        seconds: Time from now, more than 0 s.
    """
    if not sys.platform.startswith("linux"):
        return
    signal.signal(number, signal.SIG_DFL)
    libc, timer = ctypes.CDLL(None, use_errno=True), ctypes.c_void_p()
    times = _Times(0, 0, int(seconds), int(seconds % 1.0 * 1e9))
    monotonic = 1  # CLOCK_MONOTONIC
    if libc.timer_create(monotonic, ctypes.byref(_Event(signal=number)), ctypes.byref(timer)) == 0:
        libc.timer_settime(timer, 0, ctypes.byref(times), None)
