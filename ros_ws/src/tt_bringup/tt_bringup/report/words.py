"""Text about a run and its balls, for the page and the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.table import Table
from tt_core.constants import RPM
from tt_core.ros.diagnostics import Event

from ..demo_metrics import DemoMetrics
from .run_record import BallRecord, RunRecord

TEXT_WIDTH = 80  # characters, width of the text in the terminal
HEAD = ("ball", "shot", "spin, rpm", "off, rpm", "hit", "landing off, cm", "latency, ms", "why not returned")


def run_summary(run: RunRecord) -> list[str]:
    """Return the summary of a run as sentences: balls returned, errors, latencies, reasons."""
    balls = run.balls
    if not balls:
        return ["The recording holds no ball: nothing was launched or measured."]
    metrics = [ball.metrics for ball in balls if ball.metrics is not None]
    sentences = [_returned(metrics) if metrics else _tried(balls)]
    if spins := [m.spin_error_rpm for m in metrics if m.spin_error_rpm is not None]:
        sentences.append(f"The spin was measured within {max(spins):.0f} rpm of the truth (median {np.median(spins):.0f} rpm).")
    if times := [ball.latencies[Event.FIRST_COMMAND] for ball in balls if Event.FIRST_COMMAND in ball.latencies]:
        sentences.append(f"The arm got its first command {np.median(times):.0f} ms after the last image ({max(times):.0f} ms at most).")
    if reasons := Counter(ball.reason for ball in balls if ball.reason):
        sentences.append(f"Not returned: {'; '.join(f'{count} x {reason}' for reason, count in reasons.most_common(5))}.")
    return sentences


def _returned(metrics: Sequence[DemoMetrics]) -> str:
    hit, landed = sum(m.hit for m in metrics), sum(m.landed for m in metrics)
    off = [value for m in metrics if (value := shown_landing_error(m)) is not None and m.landed]
    text = f"{hit} of {_count(len(metrics))} hit, {landed} landed on the opponent's half"
    return f"{text}, {100 * np.median(off):.1f} cm from where asked (median)." if off else f"{text}."


def _tried(balls: Sequence[BallRecord]) -> str:
    swung = sum(ball.swing is not None for ball in balls)
    return f"{_count(len(balls))} measured, {swung} with a swing. What became of them is not recorded: no simulator tells the truth."


def _count(number: int) -> str:
    return f"{number} ball{'' if number == 1 else 's'}"


def shown_landing_error(metrics: DemoMetrics) -> float | None:
    """Return the distance from the landing that was asked for to the one that was reached, m; None if the ball did not land."""
    if metrics.landing_reached is None:
        return None
    return float(np.hypot(*np.subtract(metrics.landing_reached, metrics.landing_asked)))


def table_row(ball: BallRecord) -> list[str]:
    """Return the cells of a ball's row in the table with the columns HEAD. A value that does not exist is a dash."""
    m, spin = ball.metrics, ball.measured.spin if ball.measured is not None else None
    off = shown_landing_error(m) if m is not None else None
    first = ball.latencies.get(Event.FIRST_COMMAND)
    return [
        str(ball.number),
        m.kind if m is not None else "-",
        "-" if spin is None else f"{np.linalg.norm(spin) / RPM:.0f}",
        "-" if m is None or m.spin_error_rpm is None else f"{m.spin_error_rpm:.0f}",
        "-" if m is None else "yes" if m.hit else "no",
        "-" if off is None else f"{100 * off:.1f}",
        "-" if first is None else f"{first:.0f}",
        ball.reason or "",
    ]


def facts(ball: BallRecord) -> list[tuple[str, str]]:
    """Return what is known about a ball as pairs of texts: the name of a quantity, and its value with unit."""
    found: list[tuple[str, str]] = []
    m, measured = ball.metrics, ball.measured
    if measured is not None:
        found.append(("measured speed", f"{np.linalg.norm(measured.velocity):.2f} m/s"))
        found.append(("measured spin", _spin(measured.spin)))
    if m is not None:
        found.append(("true spin", _spin(np.array(m.spin_true)) + (f", {m.spin_error_rpm:.0f} rpm off" if m.spin_error_rpm else "")))
        if m.hit_place is not None and m.hit_error_m is not None:
            found.append(("hit at x, y, z", f"{_places(m.hit_place)} m, {1e3 * m.hit_error_m:.1f} mm from the racket's middle"))
    if ball.goal is not None:
        found.append(("landing asked", f"x, y = {_places(ball.goal.landing.tolist())} m, {ball.goal.flight_time:.2f} s after the hit"))
        found.append(("return spin asked", f"{ball.goal.spin_y:.0f} rad/s about y, {ball.goal.spin_z:.0f} rad/s about z"))
    if m is not None and m.landing_reached is not None:
        late = "" if m.time_error_s is None else f", {abs(1e3 * m.time_error_s):.1f} ms {'late' if m.time_error_s > 0 else 'early'}"
        off = shown_landing_error(m) or 0.0
        found.append(("landing reached", f"x, y = {_places(m.landing_reached)} m, {100 * off:.1f} cm off{late}"))
    if m is not None and m.return_spin_reached is not None:
        y, z = m.return_spin_reached
        found.append(("return spin reached", f"{round(y)} rad/s about y, {round(z)} rad/s about z"))
    if ball.warnings:
        found.append(("warnings", "; ".join(ball.warnings)))
    return found


def _spin(spin: np.ndarray) -> str:
    x, y, z = spin / RPM
    return f"{np.linalg.norm(spin) / RPM:.0f} rpm (x, y, z: {x:.0f}, {y:.0f}, {z:.0f})"


def _places(values: Sequence[float]) -> str:
    return ", ".join(f"{value + 0.0:.3f}" for value in values)


def print_run(run: RunRecord, console: Console | None = None) -> None:
    """Print the summary of a run and a table of its balls, at most TEXT_WIDTH characters wide.

    Args:
        run: The run.
        console: Where to print; None for standard output.
    """
    console = console or Console()
    console.width = min(console.width, TEXT_WIDTH)
    for sentence in run_summary(run):
        console.print(sentence, markup=False, highlight=False)
    if not run.balls:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in HEAD[:-1]:
        table.add_column(name, justify="left" if name == HEAD[1] else "right")
    for ball in run.balls:
        table.add_row(*table_row(ball)[:-1])
    console.print(table)
    for ball in run.balls:
        if ball.reason:
            console.print(f"ball {ball.number} was not returned: {ball.reason}", markup=False, highlight=False)
