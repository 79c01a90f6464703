"""A second renderer that shares nothing with tt_sim's: other marks, other light, other sensor, plain numpy.

Marks are thresholded noise, spots or strokes; light is a broad window that wraps around the ball and a sky, with Phong's gloss, a lens that
is darker in the corners and a background that is not black. What is measured on both renderers does not rest on what one of them draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from tt_core.constants import RPM
from tt_core.flight import Aerodynamics
from tt_core.states import Array, BallState
from tt_vision.camera import Camera
from tt_vision.rig import FRAME_RATE, VIEW_CENTRE, high_speed_pair

RADIUS = 0.02  # m
SAMPLES = 9  # rays a pixel, 3 x 3 and as many instants


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def noise_marks(rng: np.random.Generator, part: float = 0.15) -> Callable[[Array], Array]:
    """Islands of every shape: the darkest `part` of a sum of waves on the sphere."""
    waves, phases = unit(rng.standard_normal((40, 3))) * rng.uniform(4.0, 9.0, (40, 1)), rng.uniform(0.0, 6.3, 40)
    level = np.quantile(np.cos(unit(rng.standard_normal((4000, 3))) @ waves.T + phases).sum(axis=1), 1.0 - part)
    return lambda d: np.clip(0.5 + (np.cos(d @ waves.T + phases).sum(axis=-1) - level) / 0.8, 0.0, 1.0)


def cap_marks(rng: np.random.Generator, count: int = 16) -> Callable[[Array], Array]:
    """Round spots of three sizes."""
    return dots(unit(rng.standard_normal((count, 3))), rng.uniform(0.12, 0.30, count))


def dots(centres: Array, sizes: Array | float) -> Callable[[Array], Array]:
    """Round spots about directions (n, 3); sizes: rad."""
    return lambda d: np.clip(0.5 + (sizes - np.arccos(np.clip(d @ centres.T, -1.0, 1.0))) / 0.03, 0.0, 1.0).max(axis=-1)


def stroke_marks(rng: np.random.Generator, count: int = 18) -> Callable[[Array], Array]:
    """Thick arcs of circles, crossing like handwriting."""
    poles, starts = unit(rng.standard_normal((count, 3))), unit(rng.standard_normal((count, 3)))
    tilts, wide, long = rng.uniform(-0.7, 0.7, count), rng.uniform(0.05, 0.10, count), rng.uniform(0.4, 0.9, count)

    def ink(d: Array) -> Array:
        off = np.abs(np.arcsin(np.clip(d @ poles.T, -1.0, 1.0)) - tilts) - wide
        end = np.arccos(np.clip(d @ starts.T, -1.0, 1.0)) - long
        return np.clip(0.5 - np.maximum(off, end) / 0.03, 0.0, 1.0).max(axis=-1)

    return ink


MARKS = {"noise": noise_marks, "caps": cap_marks, "strokes": stroke_marks}


@dataclass(frozen=True)
class Easel:
    """A scene. marks: direction in the ball's frame (..., 3) to ink 0..1. white, dark: albedo. lights: (direction to the lamp in `table`,
    strength, wrap: 0 is a point, 1 the whole sky). gloss, shine: Phong. background: grey level; slope: its rise across the image."""

    marks: Callable[[Array], Array]
    white: float = 0.9
    dark: float = 0.1
    lights: tuple[tuple[tuple[float, float, float], float, float], ...] = (((0.2, -1.0, 0.8), 0.55, 0.3),)
    sky: float = 0.1
    gloss: float = 0.1
    shine: float = 20.0
    background: float = 0.03
    slope: float = 0.0
    vignette: float = 0.1
    gamma: float = 1.0
    blur: float = 0.6
    exposure: float = 200e-6
    grain: float = 0.006  # of full scale
    bits: int = 8
    cameras: tuple[Camera, Camera] = field(default_factory=high_speed_pair)

    def draw(self, camera: Camera, ball: BallState, turn: Array, rng: np.random.Generator) -> np.ndarray:
        """(h, w) uint8 or uint16. turn: (3, 3) ball to `table` in the middle of the exposure."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        x, y = u / (camera.width - 1) - 0.5, v / (camera.height - 1) - 0.5
        image = self.background + self.slope * (x + 0.5 * y + 0.25)
        at = camera.project(ball.position[None])[0]
        reach = 1.15 * camera.focal_pixels * RADIUS / (camera.rotation @ ball.position + camera.translation)[2] + 4.0
        c0, c1 = (int(np.clip(a, 0, camera.width)) for a in (at[0] - reach, at[0] + reach))
        r0, r1 = (int(np.clip(a, 0, camera.height)) for a in (at[1] - reach, at[1] + reach))
        total = np.zeros((r1 - r0, c1 - c0))
        for i, instant in enumerate(rng.permutation(SAMPLES)):
            tau = self.exposure * ((instant + 0.5) / SAMPLES - 0.5)
            pixels = np.stack([u[r0:r1, c0:c1] + (i % 3 - 1) / 3, v[r0:r1, c0:c1] + (i // 3 - 1) / 3], axis=-1)
            rays = camera.rays(pixels.reshape(-1, 2)).reshape(pixels.shape[:2] + (3,)) @ camera.rotation
            centre = ball.position + tau * ball.velocity - camera.position
            along = rays @ centre
            gap = along**2 - centre @ centre + RADIUS**2
            hit = gap > 0.0
            normal = (rays * (along - np.sqrt(np.maximum(gap, 0.0)))[..., None] - centre) / RADIUS
            spun = Rotation.from_rotvec(tau * ball.spin).as_matrix() @ turn
            shown = image[r0:r1, c0:c1].copy()
            shown[hit] = self._shade(normal[hit], rays[hit], spun)
            total += shown / SAMPLES
        if total.size:
            image[r0:r1, c0:c1] = total
        image = gaussian_filter(image * (1.0 - self.vignette * (x**2 + y**2)), self.blur)
        image = image + self.grain * np.sqrt(0.3 + np.maximum(image, 0.0)) * rng.standard_normal(image.shape)
        top = 2**self.bits - 1
        return np.clip(np.rint(top * np.maximum(image, 0.0) ** (1.0 / self.gamma)), 0, top).astype(
            np.uint8 if self.bits <= 8 else np.uint16
        )

    def _shade(self, normal: Array, rays: Array, turn: Array) -> Array:
        albedo = self.white + (self.dark - self.white) * self.marks(normal @ turn)
        light, shine = self.sky * (0.75 + 0.25 * normal[:, 2]), np.zeros(len(normal))
        for towards, strength, wrap in self.lights:
            d = unit(np.array(towards))
            light = light + strength * np.maximum(0.0, (normal @ d + wrap) / (1.0 + wrap)) ** (1.0 + wrap)
            mirrored = 2.0 * (normal @ d)[:, None] * normal - d
            shine += strength * np.maximum(0.0, -(mirrored * rays).sum(axis=1)) ** self.shine
        return albedo * light + self.gloss * shine


def random_easel(rng: np.random.Generator, **fixed) -> Easel:
    """A scene in which a person would say that the ball and its marks are seen well enough."""
    lights = [((rng.uniform(-1, 1), -1.0, rng.uniform(0.2, 1.5)), rng.uniform(0.35, 0.6), rng.uniform(0.0, 0.6))]
    if rng.random() < 0.7:
        lights.append(
            ((rng.uniform(-1.5, 1.5), rng.uniform(-1.0, 0.3), rng.uniform(-0.3, 1.5)), rng.uniform(0.1, 0.35), rng.uniform(0.0, 0.5))
        )
    choices = {
        "marks": MARKS[rng.choice(list(MARKS))](rng),
        "white": rng.uniform(0.75, 0.95),
        "dark": rng.uniform(0.03, 0.3),
        "lights": tuple(lights),
        "sky": rng.uniform(0.05, 0.2),
        "gloss": rng.uniform(0.0, 0.15),
        "shine": rng.uniform(5.0, 40.0),
        "background": rng.uniform(0.0, 0.08),
        "slope": rng.uniform(-0.04, 0.04),
        "gamma": rng.uniform(0.9, 1.3),
        "blur": rng.uniform(0.4, 0.9),
    }
    return Easel(**{**choices, **fixed})


def paint(seed: int, easel: Easel | None = None, *, count: int = 6, fastest: float = 9000.0) -> tuple[np.ndarray, Array, BallState, Easel]:
    """((cameras, k, h, w), times, the ball at the last frame, the scene) of a random flight, spin about any axis up to `fastest` rpm."""
    rng = np.random.default_rng(seed)
    easel = easel or random_easel(rng)
    velocity = rng.uniform(3.0, 8.0) * unit(np.array([-1.0, rng.uniform(-0.08, 0.08), rng.uniform(-0.1, 0.35)]))
    spin = rng.uniform(0.0, fastest) * RPM * unit(rng.standard_normal(3))
    middle, first = np.array(VIEW_CENTRE) + rng.uniform(-0.01, 0.01, 3), Rotation.random(random_state=seed)
    times = np.arange(count) / FRAME_RATE
    pull = Aerodynamics.measured().acceleration(velocity, spin)
    frames = []
    for tau in times - times.mean():
        ball = BallState(times.mean() + tau, middle + tau * velocity + 0.5 * tau**2 * pull, velocity + tau * pull, spin)
        turn = (Rotation.from_rotvec(tau * spin) * first).as_matrix()
        frames.append([easel.draw(camera, ball, turn, rng) for camera in easel.cameras])
    return np.swapaxes(np.array(frames), 0, 1), times, ball, easel
