"""What a camera sees of a marked ball: rays on a sphere, motion blur, lens blur, noise."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial.transform import Rotation
from tt_core.constants import BALL_RADIUS
from tt_core.errors import OutOfRange, check_array, check_range
from tt_core.states import Array, BallState
from tt_vision.camera import Camera, ray

SAMPLES = 16  # rays a pixel, each at its own instant of the exposure: 0.5 grey levels rms
FACE = 256  # texels along one face of the cube of a texture, 0.2 pixels in the image
SHARPNESS = 5  # doublings of the cosine power of the specular lobe: cos^32, a lobe of 20 deg as of matt celluloid

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class Texture:
    """albedo: (6, n, n) on the faces +x, -x, +y, -y, +z, -z of a cube in the frame of the ball. gloss: specular part at normal view."""

    albedo: npt.NDArray[np.float32]
    gloss: float = 0.04  # of the lamp, smooth plastic

    @classmethod
    def plain(cls, albedo: float = 0.85) -> Texture:
        return cls(np.full((6, FACE, FACE), albedo, dtype=np.float32))

    @classmethod
    def drawn(cls, seed: int = 0, *, blobs: int = 12, coverage: float = 0.13, white: float = 0.85, dark: float = 0.08) -> Texture:
        """A white ball with dark marks as if drawn by hand: lines, rectangles, ellipses and irregular spots, no two alike.

        coverage: part of the surface that the marks cover, 13 % measured on the dissertation's Figure 2.3.
        """
        rng = np.random.default_rng(seed)
        shapes = [_Shape(rng, i) for i in range(blobs)]
        centres = _spread(rng, blobs)
        directions = _cube_directions(FACE).reshape(-1, 3)
        coarse = directions[rng.permutation(len(directions))[:8000]]
        solid = np.abs(coarse).max(axis=1) ** 3  # solid angle of a texel
        low, high = 0.02, 0.6  # rad, size of a mark
        for _ in range(12):
            size = (low + high) / 2
            part = np.average(_ink(coarse, centres, shapes, size), weights=solid)
            low, high = (size, high) if part < coverage else (low, size)
        ink = _ink(directions, centres, shapes, (low + high) / 2).reshape(6, FACE, FACE)
        return cls((white + (dark - white) * ink).astype(np.float32))


class _Shape:
    """The outline of one mark: inside where `depth` > 0, in units of its size."""

    def __init__(self, rng: np.random.Generator, kind: int) -> None:
        self.kind = kind % 4
        self.turn = rng.uniform(0.0, 2.0 * math.pi)
        self.length = rng.uniform(0.8, 1.3)
        self.width = self.length * (rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.8), rng.uniform(0.4, 0.75), 0.9)[self.kind]
        self.bend = rng.uniform(-0.5, 0.5)
        self.wobble = rng.uniform(0.05, 0.2, 4) * np.exp(2j * math.pi * rng.uniform(size=4))

    def depth(self, x: Array, y: Array) -> Array:
        x, y = math.cos(self.turn) * x + math.sin(self.turn) * y, math.cos(self.turn) * y - math.sin(self.turn) * x
        if self.kind == 0:  # a thick, bent line
            y = y - self.bend * x * x
            return self.width - np.hypot(y, np.maximum(np.abs(x) - self.length, 0.0))
        if self.kind == 1:  # a rectangle
            return np.minimum(self.length - np.abs(x), self.width - np.abs(y))
        angle, r = np.arctan2(y, x), np.hypot(x / self.length, y / self.width)
        if self.kind == 2:  # an ellipse
            return (1.0 - r) * self.width
        edge = 1.0 + sum((c * np.exp(1j * (k + 2) * angle)).real for k, c in enumerate(self.wobble))
        return (edge - r) * self.width


def _spread(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) unit vectors, roughly even: the best of many draws for each one in turn."""
    chosen = [_unit(rng.standard_normal(3))]
    while len(chosen) < count:
        draws = _unit(rng.standard_normal((12, 3)))
        chosen.append(draws[np.argmin((draws @ np.array(chosen).T).max(axis=1))])
    return np.array(chosen)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _ink(directions: Array, centres: Array, shapes: list[_Shape], size: float) -> Array:
    """(n,) 0 for bare, 1 for marked, in between within the soft edge of a mark."""
    soft = 0.015  # rad, a pen's edge
    ink = np.zeros(len(directions))
    for centre, shape in zip(centres, shapes, strict=True):
        near = np.flatnonzero(directions @ centre > math.cos(min(math.pi, 2.5 * size)))
        e1 = _unit(np.cross(centre, [0.3, 0.5, 0.8]))
        e2 = np.cross(centre, e1)
        d = directions[near]
        x, y, z = d @ e1, d @ e2, d @ centre
        stretch = np.arctan2(np.hypot(x, y), z) / np.maximum(np.hypot(x, y), 1e-9) / size  # equidistant map
        depth = shape.depth(x * stretch, y * stretch) * size
        ink[near] = np.maximum(ink[near], np.clip(0.5 + depth / soft, 0.0, 1.0))
    return ink


def _cube_directions(n: int) -> Array:
    """(6, n, n, 3) unit vectors to the texels."""
    a = (2.0 * np.arange(n) + 1.0) / n - 1.0
    u, v = np.meshgrid(a, a, indexing="ij")
    faces = np.empty((6, n, n, 3))
    for face in range(6):
        axis = face // 2
        faces[face, ..., axis] = 1.0 if face % 2 == 0 else -1.0
        faces[face, ..., (axis + 1) % 3], faces[face, ..., (axis + 2) % 3] = u, v
    return _unit(faces)


@dataclass(frozen=True)
class Lamp:
    """A small lamp. position: m in `table`. strength: grey (1 is full scale) of an ideal white surface facing it from 1 m; it falls with
    the square of the distance. flicker: relative amplitude of its ripple; ripple: 1/s."""

    position: tuple[float, float, float]
    strength: float
    flicker: float = 0.02  # a 300 W halogen filament on alternating current
    ripple: float = 100.0  # 1/s, twice the mains


@dataclass(frozen=True)
class Lamps:
    """All light on the ball. ambient: grey of a white ideal surface. background: grey of the black cloth behind."""

    lamps: tuple[Lamp, ...] = (
        Lamp((2.15, 0.42, 0.75), 0.24),  # 0.7 m from the ball, above the left camera (two lamps: dissertation Section 2.5)
        Lamp((3.10, 0.02, 0.45), 0.50),  # 1 m from the ball, right of the right camera
    )
    ambient: float = 0.14
    background: float = 0.03


@dataclass(frozen=True)
class Noise:
    """The lens and the sensor. lens_blur: pixels, sigma. full_scale, read: electrons. bits: of a grey level. gamma: 1 is linear."""

    lens_blur: float = 0.6
    full_scale: float = 20e3  # dissertation Table A.6: 1.4 V / (10.7 uV per electron) would be 130 ke-; 20 ke- is the careful choice
    read: float = 65.0  # dissertation Table A.6: 0.7 mV / (10.7 uV per electron)
    bits: int = 8
    gamma: float = 1.0

    def __post_init__(self) -> None:
        check_range("lens_blur", self.lens_blur, 0.0, 3.0)
        check_range("full_scale", self.full_scale, 1.0, 1e9)
        if self.bits not in range(1, 17):
            raise OutOfRange("bits", self.bits, 1, 16)


@dataclass(frozen=True)
class Scene:
    """What the cameras share: the ball's marks, the light, the sensor."""

    texture: Texture = field(default_factory=functools.cache(Texture.drawn))
    lamps: Lamps = field(default_factory=Lamps)
    noise: Noise = field(default_factory=Noise)


def render(
    camera: Camera,
    ball: BallState,
    orientation: Array,
    texture: Texture,
    lamps: Lamps,
    exposure: float,
    noise: Noise,
    rng: np.random.Generator,
) -> Image:
    """One image of the ball.

    ball: at the middle of the exposure; it moves and spins on during it. orientation: (3, 3) ball to `table` at that instant.
    exposure: s. Returns (height, width) uint8, or uint16 above 8 bits. Raises a TtError for an argument that is not finite.
    """
    turn = check_array("orientation", orientation, (3, 3))
    check_range("exposure", exposure, 0.0, 0.1)
    clear = np.full((camera.height, camera.width), lamps.background, dtype=np.float32)
    box = _box(camera, ball, exposure)
    if box is not None:
        sources = np.array([(*lamp.position, lamp.strength * _ripple(lamp, ball.time)) for lamp in lamps.lamps]).reshape(-1, 4)
        vector = camera.vector
        state = np.concatenate([ball.position, ball.velocity])
        instants = exposure * ((np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5)
        turns = Rotation.from_rotvec(np.outer(instants, ball.spin)).as_matrix() @ turn
        shifts = rng.random((box[3] - box[2], box[1] - box[0], 3), dtype=np.float32)
        _trace(clear, box, vector, state, turns, texture.albedo, texture.gloss, sources, lamps.ambient, exposure, shifts)
        if noise.lens_blur > 0.0:
            _blur(clear, box, _kernel(noise.lens_blur))
    top = (1 << noise.bits) - 1
    image = np.empty(clear.shape, dtype=np.uint8 if noise.bits <= 8 else np.uint16)
    _expose(image, clear, rng.standard_normal(clear.shape, dtype=np.float32), noise.full_scale, noise.read, noise.gamma, top)
    return image


def _ripple(lamp: Lamp, time: float) -> float:
    return 1.0 + lamp.flicker * math.sin(2.0 * math.pi * lamp.ripple * time)


def _kernel(sigma: float) -> npt.NDArray[np.float32]:
    reach = max(1, math.ceil(3.0 * sigma))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return (taps / taps.sum()).astype(np.float32)


def _box(camera: Camera, ball: BallState, exposure: float) -> npt.NDArray[np.int64] | None:
    """(4,) first and past-last column and row that the ball can touch, or None when it is out of view."""
    ends = ball.position + np.outer([-0.5, 0.5], exposure * ball.velocity)
    depth = (ends @ camera.rotation.T + camera.translation)[:, 2].min()
    if depth < 2.0 * BALL_RADIUS:
        return None
    reach = 1.1 * camera.focal_pixels * BALL_RADIUS / depth + 3.0
    pixels = camera.project(ends)
    size = np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0) - reach), 0, size)
    high = np.clip(np.ceil(pixels.max(axis=0) + reach) + 1, 0, size)
    if (low >= high).any():
        return None
    return np.array([low[0], high[0], low[1], high[1]], dtype=np.int64)


@njit(cache=True, nogil=True, fastmath=True)
def _albedo(faces: np.ndarray, x: float, y: float, z: float) -> float:
    n = faces.shape[1]
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, w = 0, y, z, x
    elif ay >= az:
        face, u, v, w = 2, z, x, y
    else:
        face, u, v, w = 4, x, y, z
    if w < 0.0:
        face += 1
        w = -w
    i = min(n - 1, int((u / w + 1.0) * 0.5 * n))
    j = min(n - 1, int((v / w + 1.0) * 0.5 * n))
    return faces[face, i, j]


@njit(cache=True, nogil=True, fastmath=True)
def _trace(
    clear: np.ndarray,
    box: np.ndarray,
    camera: np.ndarray,
    state: np.ndarray,
    turns: np.ndarray,
    faces: np.ndarray,
    gloss: float,
    sources: np.ndarray,
    ambient: float,
    exposure: float,
    shifts: np.ndarray,
) -> None:
    """Fills the box of `clear`, which holds the background. Sub-pixel positions follow the golden sequence in the plane and instants are
    evenly spaced, both shifted at random in each pixel: together even over pixel and time."""
    r = camera[:9].copy().reshape(3, 3)
    eye = -(r.T @ camera[9:12])
    samples = len(turns)
    instants = exposure * ((np.arange(samples) + 0.5) / samples - 0.5)
    centres = np.empty((samples, 4))
    for i in range(samples):
        for a in range(3):
            centres[i, a] = state[a] + instants[i] * state[3 + a] - eye[a]
        centres[i, 3] = centres[i, 0] ** 2 + centres[i, 1] ** 2 + centres[i, 2] ** 2 - BALL_RADIUS**2
    middle = state[:3] - eye
    far = math.sqrt(middle @ middle)
    middle /= far
    wide = (BALL_RADIUS + 0.5 * exposure * math.sqrt(state[3:] @ state[3:])) / far + 2.0 / camera[12]
    skip = math.cos(1.01 * wide)
    for row in range(box[2], box[3]):
        for column in range(box[0], box[1]):
            x, y = ray(camera, column, row)
            scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
            towards = 0.0
            for a in range(3):
                towards += (r[0, a] * x + r[1, a] * y + r[2, a]) * scale * middle[a]
            if towards < skip:
                continue  # two pixels beside the blurred ball
            shift_u, shift_v = shifts[row - box[2], column - box[0], 0], shifts[row - box[2], column - box[0], 1]
            i = int(shifts[row - box[2], column - box[0], 2] * samples)
            total = 0.0
            for _ in range(samples):
                shift_u += 0.7548776662466927
                shift_v += 0.5698402909980532
                shift_u -= 1.0 if shift_u >= 1.0 else 0.0
                shift_v -= 1.0 if shift_v >= 1.0 else 0.0
                i = i + 1 if i + 1 < samples else 0
                x, y = ray(camera, column - 0.5 + shift_u, row - 0.5 + shift_v)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                dx = (r[0, 0] * x + r[1, 0] * y + r[2, 0]) * scale
                dy = (r[0, 1] * x + r[1, 1] * y + r[2, 1]) * scale
                dz = (r[0, 2] * x + r[1, 2] * y + r[2, 2]) * scale
                along = dx * centres[i, 0] + dy * centres[i, 1] + dz * centres[i, 2]
                gap = along * along - centres[i, 3]
                if gap <= 0.0:
                    total += clear[row, column]
                    continue
                reach = along - math.sqrt(gap)
                hx, hy, hz = reach * dx, reach * dy, reach * dz  # from the eye
                nx = (hx - centres[i, 0]) / BALL_RADIUS
                ny = (hy - centres[i, 1]) / BALL_RADIUS
                nz = (hz - centres[i, 2]) / BALL_RADIUS
                albedo = _albedo(
                    faces,
                    turns[i, 0, 0] * nx + turns[i, 1, 0] * ny + turns[i, 2, 0] * nz,
                    turns[i, 0, 1] * nx + turns[i, 1, 1] * ny + turns[i, 2, 1] * nz,
                    turns[i, 0, 2] * nx + turns[i, 1, 2] * ny + turns[i, 2, 2] * nz,
                )
                light, shine = ambient, 0.0
                for k in range(len(sources)):
                    lx = sources[k, 0] - eye[0] - hx
                    ly = sources[k, 1] - eye[1] - hy
                    lz = sources[k, 2] - eye[2] - hz
                    facing = nx * lx + ny * ly + nz * lz
                    if facing <= 0.0:
                        continue
                    near = 1.0 / (lx * lx + ly * ly + lz * lz)
                    scale = math.sqrt(near)
                    power = sources[k, 3] * near
                    light += power * facing * scale
                    bx, by, bz = lx * scale - dx, ly * scale - dy, lz * scale - dz  # half way between lamp and eye
                    lobe = (nx * bx + ny * by + nz * bz) ** 2 / (bx * bx + by * by + bz * bz)
                    for _ in range(SHARPNESS - 1):
                        lobe *= lobe
                    shine += power * lobe
                total += albedo * light + gloss * shine
            clear[row, column] = total / samples


@njit(cache=True, nogil=True)
def _blur(clear: np.ndarray, box: np.ndarray, taps: np.ndarray) -> None:
    """Separable, edges continued."""
    reach = len(taps) // 2
    height, width = clear.shape
    u0, u1, v0, v1 = max(0, box[0] - reach), min(width, box[1] + reach), max(0, box[2] - reach), min(height, box[3] + reach)
    across = np.empty((height, width), dtype=np.float32)
    for v in range(max(0, v0 - reach), min(height, v1 + reach)):
        for u in range(u0, u1):
            s = np.float32(0.0)
            for k in range(-reach, reach + 1):
                s += taps[k + reach] * clear[v, min(width - 1, max(0, u + k))]
            across[v, u] = s
    for v in range(v0, v1):
        for u in range(u0, u1):
            s = np.float32(0.0)
            for k in range(-reach, reach + 1):
                s += taps[k + reach] * across[min(height - 1, max(0, v + k)), u]
            clear[v, u] = s


@njit(cache=True, nogil=True)
def _expose(image: np.ndarray, clear: np.ndarray, normal: np.ndarray, full_scale: float, read: float, gamma: float, top: int) -> None:
    """Shot and read noise as one normal draw, then gamma and rounding."""
    for v in range(clear.shape[0]):
        for u in range(clear.shape[1]):
            electrons = full_scale * clear[v, u]
            grey = clear[v, u] + normal[v, u] * math.sqrt(electrons + read * read) / full_scale
            if gamma != 1.0:
                grey = max(grey, 0.0) ** (1.0 / gamma)
            image[v, u] = min(top, max(0, int(top * grey + 0.5)))
