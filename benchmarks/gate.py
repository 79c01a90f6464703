"""Which measurements are believed: false acceptances and refusals over light, blur, sizes and marks of all kinds. scripts/bench gate

--runs bursts of six frames (default 2000), each drawn from: balls of 40 to 150 pixels, lens blur of 0.5 to 3 pixels, 20 to 230 grey levels
between ball and background, 0 to 9,000 rpm about any axis, on whole images or on regions cut out around the ball, with marks of one of the
kinds of MARKS. A false acceptance is a spin that is believed and off by more than 300 rpm. What is measurable is told by what is rendered,
not by what comes out: `is_measurable`. A tenth as many bursts of 12 frames of one camera at 380 frames a second follow, of balls that turn
100 to 150 times a second: right within 1 %, refused, told as ambiguous, or wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from report import arguments, report
from scipy.spatial.transform import Rotation
from tt_core.constants import BALL_RADIUS, GRAVITY, RPM
from tt_core.states import BallState
from tt_eval.synthetic_bursts import BurstConditions, render_burst
from tt_sim.render import FACE, Lamps, Noise, Texture, render
from tt_vision.capture.burst import Burst
from tt_vision.detection.ball_detection import detect_balls
from tt_vision.measure import measure_burst
from tt_vision.rig import EXPOSURE, FRAME_RATE, VIEW_CENTRE, high_speed_pair
from tt_vision.spin import SearchParams, SpinReason

WRONG = 300.0  # rpm
SIZE = 320  # pixels of an image, in which a ball of 150 pixels is whole for six frames
ROOM = 12  # pixels around the ball in a region that is cut out
FULL = 180.0  # grey levels that the renderer's lamps give
SLOW = BurstConditions(frames=12, frame_rate=380.0)
TURNS = (100.0, 150.0)  # 1/s


def directions() -> np.ndarray:
    """Unit vectors (6, FACE, FACE, 3) to the texels of a texture, on the faces +x, -x, +y, -y, +z, -z."""
    a = (2.0 * np.arange(FACE) + 1.0) / FACE - 1.0
    u, v = np.meshgrid(a, a, indexing="ij")
    faces = np.empty((6, FACE, FACE, 3))
    for face in range(6):
        axis = face // 2
        faces[face, ..., axis] = 1.0 - 2.0 * (face % 2)
        faces[face, ..., (axis + 1) % 3], faces[face, ..., (axis + 2) % 3] = u, v
    return faces / np.linalg.norm(faces, axis=-1, keepdims=True)


def painted(dark: np.ndarray) -> Texture:
    return Texture(np.where(dark, 0.08, 0.85).astype(np.float32))


def regular_dots(rng: np.random.Generator) -> Texture:
    """Twelve equal dots at the corners of an icosahedron, which looks alike after 60 turns."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = np.array([np.roll([0.0, a, b * golden], k) for k in range(3) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    return painted((directions() @ corners.T).max(axis=-1) > np.cos(rng.uniform(0.2, 0.35)))


def brush_marks(rng: np.random.Generator) -> Texture:
    """Six long strokes: parts of small circles."""
    toward, dark = directions(), np.zeros((6, FACE, FACE), dtype=bool)
    for axis in Rotation.random(6, random_state=int(rng.integers(1 << 31))).as_matrix()[:, 0]:
        other = np.cross(axis, [0.3, 0.5, 0.8])
        dark |= (np.abs(toward @ axis - rng.uniform(-0.6, 0.6)) < rng.uniform(0.05, 0.12)) & (toward @ other > rng.uniform(-0.2, 0.4))
    return painted(dark)


def half_coloured(rng: np.random.Generator) -> Texture:
    """One half darker, as a two-coloured ball is in grey, with a logo on either half."""
    toward, (one, two) = directions(), rng.standard_normal((2, 3))
    albedo = np.where(toward[..., 2] > 0.0, 0.85, 0.45).astype(np.float32)
    for logo in (one / np.linalg.norm(one), two / np.linalg.norm(two)):
        albedo[toward @ logo > np.cos(rng.uniform(0.2, 0.3))] = 0.08
    return Texture(albedo)


MARKS: dict[str, Callable[[np.random.Generator], Texture]] = {
    "drawn": lambda rng: Texture.drawn(int(rng.integers(1000)), blobs=int(rng.integers(10, 25)), coverage=rng.uniform(0.1, 0.25)),
    "regular dots": regular_dots,
    "logo": lambda rng: Texture.drawn(int(rng.integers(1000)), blobs=1, coverage=rng.uniform(0.02, 0.05)),
    "brush": brush_marks,
    "half coloured": half_coloured,
}


@dataclass(frozen=True)
class Conditions:
    """Of one burst. diameter, blur: pixels. contrast: grey levels. is_cut_out: whether regions are cut out around the ball."""

    marks: str
    diameter: float
    blur: float
    contrast: float
    is_cut_out: bool

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Conditions:
        marks = str(rng.choice(list(MARKS), p=[0.6, 0.1, 0.1, 0.1, 0.1]))
        return cls(marks, rng.uniform(40.0, 150.0), rng.uniform(0.5, 3.0), rng.uniform(20.0, 230.0), bool(rng.integers(2)))

    @property
    def is_measurable(self) -> bool:
        """Many marks of different shapes, blurred by less than 1/25 of the ball, in 40 or more grey levels."""
        return self.marks == "drawn" and self.blur < 0.04 * self.diameter and self.contrast >= 40.0


def filmed(c: Conditions, rng: np.random.Generator) -> tuple[Burst, BallState]:
    """Render a burst; return it with the truth at its last frame."""
    light = Lamps()
    scale = c.contrast / FULL
    lamps = replace(
        light, lamps=tuple(replace(lamp, strength=scale * lamp.strength) for lamp in light.lamps), ambient=scale * light.ambient
    )
    cameras = []
    for camera in high_speed_pair():
        distance = np.linalg.norm(camera.position - VIEW_CENTRE)
        focal = c.diameter / (2.0 * BALL_RADIUS) * distance * camera.pixel_size
        cameras.append(replace(camera, focal_length=focal, width=SIZE, height=SIZE, principal_point=None))
    direction = np.array([-1.0, rng.uniform(-0.08, 0.08), rng.uniform(-0.1, 0.35)])
    velocity = rng.uniform(3.0, 6.0) * direction / np.linalg.norm(direction)
    spin = rng.uniform(0.0, 9000.0) * RPM * Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()[0]
    first, texture = Rotation.random(random_state=int(rng.integers(1 << 31))), MARKS[c.marks](rng)
    times, fall = np.arange(6) / FRAME_RATE, np.array([0.0, 0.0, -GRAVITY])
    images = [[] for _ in cameras]
    for tau in times - times.mean():
        ball = BallState(times.mean() + tau, np.array(VIEW_CENTRE) + tau * velocity + 0.5 * tau**2 * fall, velocity + tau * fall, spin)
        turned = (Rotation.from_rotvec(tau * spin) * first).as_matrix()
        for row, camera in zip(images, cameras, strict=True):
            row.append(render(camera, ball, turned, texture, lamps, EXPOSURE, Noise(lens_blur=c.blur), rng))
    burst = Burst(tuple(np.array(row) for row in images), times, tuple(cameras))
    return (cut_out(burst) if c.is_cut_out else burst), ball


def cut_out(burst: Burst) -> Burst:
    """Return the burst with one region of each camera's images, just large enough for the ball in all frames."""
    found, images, cameras = detect_balls(burst), [], []
    for stack, row, camera in zip(burst.images, found.detections, burst.cameras, strict=True):
        seen = [ball for ball in row if ball.reason is None]
        if not seen:
            return burst
        low, high = (
            np.clip(
                [
                    limit(ball.u + side * (ball.radius + ROOM) for ball in seen),
                    limit(ball.v + side * (ball.radius + ROOM) for ball in seen),
                ],
                0,
                SIZE,
            ).astype(int)
            for limit, side in ((min, -1.0), (max, 1.0))
        )
        images.append(np.ascontiguousarray(stack[:, low[1] : high[1], low[0] : high[0]]))
        middle = camera.principal_point - low
        cameras.append(replace(camera, width=int(high[0] - low[0]), height=int(high[1] - low[1]), principal_point=middle))
    return Burst(tuple(images), burst.times, tuple(cameras))


def main() -> None:
    args = arguments("gate", 2000, seed=0)
    rng = np.random.default_rng(args.seed)
    counts = Counter[tuple[str, str]]()
    for _ in range(args.runs):
        conditions = Conditions.draw(rng)
        burst, truth = filmed(conditions, rng)
        found = measure_burst(burst).ball
        result = "refused" if found is None else "wrong" if np.linalg.norm(found.spin - truth.spin) / RPM > WRONG else "right"
        counts[conditions.marks, result] += 1
        if conditions.is_measurable:
            counts["measurable", result] += 1
    metrics: dict[str, float] = {"false acceptances": float(sum(counts[marks, "wrong"] for marks in MARKS))}
    for kind in ("measurable", *MARKS):
        total = sum(counts[kind, result] for result in ("right", "wrong", "refused"))
        metrics |= {f"{kind}: bursts": float(total)} | {f"{kind}: {r}": float(counts[kind, r]) for r in ("right", "wrong", "refused")}
        metrics[f"{kind}: refused, %"] = 100.0 * counts[kind, "refused"] / max(1, total)
    slow = Counter(turning(rng) for _ in range(max(1, args.runs // 10)))
    metrics |= {
        f"380 frames a second: {result}, %": 100.0 * slow[result] / slow.total() for result in ("right", "refused", "ambiguous", "wrong")
    }
    report("gate", args.runs, metrics, args.json)


def turning(rng: np.random.Generator) -> str:
    """Return what became of a ball that turns fast before one slow camera."""
    spin = 2.0 * np.pi * rng.uniform(*TURNS) * Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()[0]
    texture = Texture.drawn(int(rng.integers(1000)))
    shot = render_burst(np.array(VIEW_CENTRE), np.array([-2.0, 0.0, 0.3]), spin, texture, SLOW, rng)
    result = measure_burst(shot.left_burst, search=SearchParams(max_spin=1000.0))
    if result.ball is None:
        return "ambiguous" if result.reason is not None and result.reason.code is SpinReason.AMBIGUOUS else "refused"
    return "right" if np.linalg.norm(result.ball.spin - spin) < 0.01 * np.linalg.norm(spin) else "wrong"


if __name__ == "__main__":
    main()
