"""The error of the predicted ball at the strike against the time to the strike, with and without feedback, as a small SVG."""

from __future__ import annotations

import math
import re
from pathlib import Path

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 720, 340, 64, 48, 40  # pixels
LINES = {  # name in the metrics: name in the figure, colour
    "no_feedback": ("without feedback", "#c2410c"),
    "real": ("with feedback", "#0369a1"),
}
DECADES = (0.1, 1.0, 10.0, 100.0)  # mm
LONGEST = 650.0  # ms


def _x(ahead: float) -> float:
    return LEFT + (WIDTH - LEFT - 20) * (1.0 - ahead / LONGEST)


def _y(millimetres: float) -> float:
    low, high = math.log10(DECADES[0]), math.log10(DECADES[-1])
    share = (math.log10(max(millimetres, DECADES[0])) - low) / (high - low)
    return HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * share


def draw(metrics: dict[str, float], file: Path) -> None:
    """Write the figure of `benchmarks/feedback.py`; metrics: its own."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="13" fill="#374151">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
    ]
    for decade in DECADES:
        y = _y(decade)
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - 20}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e5e7eb"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{decade:g}</text>')
    for ahead in (600, 400, 200, 100, 50):
        parts.append(f'<text x="{_x(ahead):.1f}" y="{HEIGHT - BOTTOM + 20}" text-anchor="middle">{ahead}</text>')
    parts.append(f'<text x="{(LEFT + WIDTH) / 2:.0f}" y="{HEIGHT - 8}" text-anchor="middle">time to the strike, ms</text>')
    parts.append(f'<text x="{LEFT}" y="18">error of the predicted place at the strike, mm; line: median, dashed: 95 %</text>')
    for k, (name, (label, colour)) in enumerate(LINES.items()):
        for share, dash in (("median", ""), ("p95", ' stroke-dasharray="5 4"')):
            found = {}
            for key, value in metrics.items():
                match = re.fullmatch(rf"{name}_strike_(\d+)_ms_place_m_{share}", key)
                if match:
                    found[float(match[1])] = 1e3 * value
            points = " ".join(f"{_x(ahead):.1f},{_y(found[ahead]):.1f}" for ahead in sorted(found, reverse=True))
            parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
        parts.append(f'<text x="{LEFT + 12}" y="{HEIGHT - BOTTOM - 30 + 18 * k}" fill="{colour}">{label}</text>')
    file.write_text("\n".join([*parts, "</svg>"]) + "\n")
