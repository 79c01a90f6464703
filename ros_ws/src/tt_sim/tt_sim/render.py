"""Rendering of camera images of a marked ball: rays on a sphere, motion blur, lens blur and noise.

The compiled functions for pixels are in single precision and loop over the rays of a pixel without a branch, so that the compiler
vectorizes them. For this purpose they read one array and write one array, at constant offsets. They work in the frame of the line of sight
to the ball, whose z axis points to the ball, in units of the ball's radius, so that all numbers are near 1.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.special import ndtri
from tt_core.arrays import Array, Image
from tt_core.constants import BALL_RADIUS
from tt_core.errors import OutOfRange, check_array, check_range
from tt_core.so3 import rotation_matrix
from tt_core.states import BallState
from tt_vision.camera import Camera
from tt_vision.projection import project_point, ray, to_camera, unpack_camera

SAMPLES = 16  # rays per pixel, each at its own time within the exposure: 0.5 grey levels rms
FACE = 256  # texels along one face of the cube of a texture; a texel is 0.2 pixels of the image
SHARPNESS = 5  # doublings of the cosine power of the specular lobe: cos^32, a lobe of 20 deg as of matt celluloid

ROW = 2 * SAMPLES  # columns of the table of ray times, which holds them twice, so that a pixel may begin at any of them
ZERO, HALF, ONE, TWO = (np.float32(x) for x in (0.0, 0.5, 1.0, 2.0))  # a plain number would make all double
GOLDEN = (np.outer([0.7548776662466927, 0.5698402909980532], np.arange(1, SAMPLES + 1)) % 1.0).astype(np.float32)  # sub-pixel places
LEVELS = 1 << 16
STRENGTH = 3  # column of a lamp's strength, after its position
NORMAL_DRAWS = ndtri((np.arange(LEVELS) + 0.5) / LEVELS).astype(np.float32)  # a normal draw for each of as many even ones, up to 4.3 sigma


@dataclass(frozen=True, eq=False)
class Texture:
    """Surface of a ball: albedo with the marks, and gloss.

    Attributes:
        albedo: (6, n, n) on the faces +x, -x, +y, -y, +z, -z of a cube in the frame of the ball.
        gloss: Specular reflectance at normal view; 0.04 is smooth plastic.
    """

    albedo: npt.NDArray[np.float32]
    gloss: float = 0.04

    @classmethod
    def plain(cls, albedo: float = 0.85) -> Texture:
        """Return the surface of a ball without marks.

        Args:
            albedo: Share of the light that the ball reflects.
        """
        return cls(np.full((6, FACE, FACE), albedo, dtype=np.float32))

    @classmethod
    def drawn(cls, seed: int = 0, *, blobs: int = 12, coverage: float = 0.13, white: float = 0.85, dark: float = 0.08) -> Texture:
        """Return the surface of a white ball with dark marks as if drawn by hand.

        The marks are lines, rectangles, ellipses and irregular spots, all different.

        Args:
            seed: Seed of the marks.
            blobs: Number of marks.
            coverage: Share of the surface that the marks cover; 13 % are measured on the dissertation's Figure 2.3.
            white: Albedo of the ball.
            dark: Albedo of the marks.
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
    """The outline of one mark, in units of its size."""

    def __init__(self, rng: np.random.Generator, kind: int) -> None:
        self.kind = kind % 4
        self.turn = rng.uniform(0.0, 2.0 * math.pi)
        self.length = rng.uniform(0.8, 1.3)
        self.width = self.length * (rng.uniform(0.3, 0.45), rng.uniform(0.5, 0.8), rng.uniform(0.4, 0.75), 0.9)[self.kind]
        self.bend = rng.uniform(-0.5, 0.5)
        self.wobble = rng.uniform(0.05, 0.2, 4) * np.exp(2j * math.pi * rng.uniform(size=4))

    def depth(self, x: Array, y: Array) -> Array:
        """Return the depth inside the outline at (x, y); negative outside."""
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
    """Return (count, 3) unit vectors, roughly even: for each one in turn the best of 12 draws."""
    chosen = [_unit(rng.standard_normal(3))]
    while len(chosen) < count:
        draws = _unit(rng.standard_normal((12, 3)))
        chosen.append(draws[np.argmin((draws @ np.array(chosen).T).max(axis=1))])
    return np.array(chosen)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _ink(directions: Array, centres: Array, shapes: list[_Shape], size: float) -> Array:
    """Return (n,) 0 for bare, 1 for marked, in between on the soft edge of a mark, in the directions (n, 3)."""
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
    """Return (6, n, n, 3) unit vectors to the texels of a cube."""
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
    """A small lamp.

    Attributes:
        position: (3,) m, in `table`.
        strength: Grey level (1 is full scale) of an ideal white surface that faces the lamp from 1 m; it falls with the square of the
            distance.
        flicker: Relative amplitude of its periodic change; 0.02 is a 300 W halogen filament on alternating current.
        ripple: 1/s, frequency of this change, twice that of the mains.
    """

    position: tuple[float, float, float]
    strength: float
    flicker: float = 0.02
    ripple: float = 100.0


@dataclass(frozen=True)
class Lamps:
    """All light on the ball.

    Attributes:
        lamps: Two as in dissertation Section 2.5: 0.7 m from the ball above the left camera, and 1 m from it right of the right camera.
        ambient: Grey level (1 is full scale) of an ideal white surface without the lamps.
        background: Grey level of the black cloth behind the ball.
    """

    lamps: tuple[Lamp, ...] = (
        Lamp((2.15, 0.42, 0.75), 0.24),
        Lamp((3.10, 0.02, 0.45), 0.50),
    )
    ambient: float = 0.14
    background: float = 0.03


@dataclass(frozen=True)
class Noise:
    """Blur of the lens, and noise and resolution of the sensor.

    Attributes:
        lens_blur: Pixels, standard deviation of the point spread.
        full_scale: Electrons at full scale. Dissertation Table A.6 gives 1.4 V / (10.7 uV per electron) = 130 ke-; 20 ke- is a cautious
            choice.
        read: Electrons, read noise; dissertation Table A.6: 0.7 mV / (10.7 uV per electron).
        bits: Number of bits of a grey level, 1 to 16.
        gamma: Gamma of the grey levels: they are the (1 / gamma)-th power of the light; 1 is linear.
    """

    lens_blur: float = 0.6
    full_scale: float = 20e3
    read: float = 65.0
    bits: int = 8
    gamma: float = 1.0

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_range("lens_blur", self.lens_blur, 0.0, 3.0)
        check_range("full_scale", self.full_scale, 1.0, 1e9)
        if self.bits not in range(1, 17):
            raise OutOfRange("bits", self.bits, 1, 16)


@dataclass(frozen=True)
class Scene:
    """What all cameras have in common: the marks on the ball, the light and the sensor.

    Attributes:
        texture: Surface of the ball with its marks.
        lamps: The light.
        noise: Lens and sensor.
    """

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
    """Render one image of the ball.

    Args:
        camera: The camera.
        ball: The ball at the middle of the exposure; it moves and spins during the exposure.
        orientation: (3, 3) from the ball's frame to `table` at this time.
        texture: Surface of the ball with its marks.
        lamps: The light.
        exposure: s.
        noise: Lens and sensor.
        rng: Random numbers for the places of rays within pixels and for the noise.

    Returns:
        (height, width) uint8, or uint16 above 8 bits.

    Raises:
        BadShape: The orientation is not (3, 3).
        NotFinite: An argument is NaN or infinite.
        OutOfRange: The exposure is not within [0, 0.1].
    """
    turn = check_array("orientation", orientation, (3, 3))
    check_range("exposure", exposure, 0.0, 0.1)
    clear = np.full((camera.height, camera.width), lamps.background, dtype=np.float32)
    vector, state = camera.vector, ball.vector
    box = _box(vector, clear.shape, state, exposure)
    drawn = 3 * (box.u1 - box.u0) * (box.v1 - box.v0)  # random numbers that the rays take
    draws = rng.integers(2**64 - 1, size=(drawn + clear.size) // 4 + 1, dtype=np.uint64, endpoint=True).view(np.uint16)  # four of each
    if drawn:
        sources = np.array([(*lamp.position, lamp.strength * _ripple(lamp, ball.time)) for lamp in lamps.lamps]).reshape(-1, 4)
        axes = _axes(vector, state)
        instants = _instants(vector, state, turn, axes, exposure)
        lights = _lights(vector, axes, sources)
        spread = 1.0 + 0.5 * exposure * float(np.linalg.norm(ball.velocity)) / BALL_RADIUS  # radii, from the middle to the end of the blur
        corners = _corners(vector, axes, box)
        rays, surface = _Rays(corners, spread, instants), _Surface(texture.albedo.ravel(), texture.gloss, lights, lamps.ambient)
        _trace(clear, box, rays, surface, draws[:drawn])
        if noise.lens_blur > 0.0:
            _blur(clear, box, _kernel(noise.lens_blur))
    image = np.empty(clear.shape, dtype=np.uint8 if noise.bits <= 8 else np.uint16)
    _expose(image.ravel(), clear.ravel(), draws[drawn:], noise.full_scale, noise.read, noise.gamma, (1 << noise.bits) - 1)
    return image


def _ripple(lamp: Lamp, time: float) -> float:
    return 1.0 + lamp.flicker * math.sin(2.0 * math.pi * lamp.ripple * time)


@functools.cache
def _kernel(sigma: float) -> npt.NDArray[np.float32]:
    reach = max(1, math.ceil(3.0 * sigma))
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return (taps / taps.sum()).astype(np.float32)


class _Box(NamedTuple):
    """A part of an image: first and past-last column and row, pixels; empty when they are the same."""

    u0: int
    u1: int
    v0: int
    v1: int


_EMPTY = _Box(0, 0, 0, 0)


class _Pose(NamedTuple):
    """Where a camera stands."""

    rotation: np.ndarray  # (3, 3) `table` to the camera's frame
    eye: np.ndarray  # (3,) m in `table`


@njit(cache=True, nogil=True)
def _pose(camera: np.ndarray) -> _Pose:
    """Return the pose of a camera from Camera.vector."""
    rotation = camera[:9].copy().reshape(3, 3)
    return _Pose(rotation, -(rotation.T @ camera[9:12]))


@njit(cache=True, nogil=True)
def _box(camera: np.ndarray, size: tuple[int, int], state: np.ndarray, exposure: float) -> _Box:
    """Return the part of an image (size: rows, columns) that the ball (state (9,)) can touch during the exposure (s)."""
    model, low, high, nearest = unpack_camera(camera), np.full(2, np.inf), np.full(2, -np.inf), np.inf
    for side in (-0.5, 0.5):
        p = state[:3] + side * exposure * state[3:6]
        x, y, z = to_camera(model, p[0], p[1], p[2])
        if z < 2.0 * BALL_RADIUS:
            return _EMPTY
        nearest = min(nearest, z)
        for k, at in enumerate(project_point(model.optics, x, y, z)):
            low[k], high[k] = min(low[k], at), max(high[k], at)
    reach = 1.1 * model.optics.focal * BALL_RADIUS / nearest + 3.0
    u0, v0 = max(0, math.floor(low[0] - reach)), max(0, math.floor(low[1] - reach))
    u1, v1 = min(size[1], math.ceil(high[0] + reach) + 1), min(size[0], math.ceil(high[1] + reach) + 1)
    return _Box(u0, u1, v0, v1) if u0 < u1 and v0 < v1 else _EMPTY


@njit(cache=True, nogil=True)
def _axes(camera: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Return (3, 3) `table` to the frame of the line of sight: z towards the centre of the ball (9,)."""
    pose = _pose(camera)
    z = state[:3] - pose.eye
    z /= math.sqrt(z @ z)
    x = np.cross(pose.rotation[1], z)
    x /= math.sqrt(x @ x)
    axes = np.empty((3, 3))
    axes[0], axes[1], axes[2] = x, np.cross(z, x), z
    return axes


@njit(cache=True, nogil=True)
def _corners(camera: np.ndarray, axes: np.ndarray, box: _Box) -> np.ndarray:
    """Return (rows + 1, columns + 1, 2) X/Z and Y/Z, in the frame of the line of sight, of the rays through the corners of the pixels."""
    turn, optics = axes @ _pose(camera).rotation.T, unpack_camera(camera).optics
    corners = np.empty((box.v1 - box.v0 + 1, box.u1 - box.u0 + 1, 2))
    for v in range(corners.shape[0]):
        for u in range(corners.shape[1]):
            x, y = ray(optics, box.u0 + u - 0.5, box.v0 + v - 0.5)
            z = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]
            corners[v, u, 0] = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) / z
            corners[v, u, 1] = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]) / z
    return corners


@njit(cache=True, nogil=True, inline="always")
def _pixel(corners: np.ndarray, v: int, u: int, k: int) -> tuple[float, float, float]:
    """Return X/Z (k = 0) or Y/Z (1) of the ray through the first corner of a pixel, and its growth along the pixel's row and column.

    Within the pixel it is linear to 1e-5 pixels.
    """
    a, b, c, d = corners[v, u, k], corners[v, u + 1, k], corners[v + 1, u, k], corners[v + 1, u + 1, k]
    along, down = 0.5 * (b + d - a - c), 0.5 * (c + d - a - b)
    return 0.25 * (a + b + c + d) - 0.5 * (along + down), along, down


@njit(cache=True, nogil=True)
def _instants(camera: np.ndarray, state: np.ndarray, turn: np.ndarray, axes: np.ndarray, exposure: float) -> np.ndarray:
    """Return where the ball is and how it is turned at instants that are evenly spaced over the exposure.

    Returns:
        (12 * ROW,): rows of the ball's centre from the eye, and of the rotation from the frame of the line of sight to the ball's.
    """
    eye = _pose(camera).eye
    table = np.empty((12, ROW), dtype=np.float32)
    for i in range(ROW):
        time = exposure * ((i % SAMPLES + 0.5) / SAMPLES - 0.5)
        table[:3, i] = axes @ (state[:3] + time * state[3:6] - eye) / BALL_RADIUS
        table[3:, i] = (turn.T @ rotation_matrix(-time * state[6:]) @ axes.T).ravel()
    return table.ravel()


@njit(cache=True, nogil=True)
def _lights(camera: np.ndarray, axes: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Return (lamps, 4) places from the eye in the frame of the line of sight, and strengths; sources: the same in `table`."""
    eye = _pose(camera).eye
    lights = np.empty(sources.shape, dtype=np.float32)
    for k in range(len(sources)):
        lights[k, :3] = axes @ (sources[k, :3] - eye) / BALL_RADIUS
        lights[k, STRENGTH] = sources[k, STRENGTH] / BALL_RADIUS**2
    return lights


class _Rays(NamedTuple):
    """Where the rays of the pixels go; frame of the line of sight, radii of the ball."""

    corners: np.ndarray  # (rows + 1, columns + 1, 2), see `_corners`
    spread: float  # from the ball's centre at the middle of the exposure to the furthest edge of its blur
    instants: np.ndarray  # (12 * ROW,), see `_instants`


class _Surface(NamedTuple):
    """What the rays meet."""

    faces: np.ndarray  # (6 n^2,) albedo, see Texture
    gloss: float
    lights: np.ndarray  # (lamps, 4), see `_lights`
    ambient: float


# offsets of the rows of the table of instants: the ball's centre, and the rotation from the frame of the line of sight to the ball's
CX, CY, CZ = (row * ROW for row in range(3))
R00, R01, R02, R10, R11, R12, R20, R21, R22 = (row * ROW for row in range(3, 12))
# offsets in the scratch array of one pixel, each for SAMPLES rays: normal, direction (x, y, 1), discriminant (positive on the ball), albedo
NX, NY, NZ, DX, DY, GAP, ALBEDO = (part * SAMPLES for part in range(7))


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _trace(clear: np.ndarray, box: _Box, rays: _Rays, surface: _Surface, draws: np.ndarray) -> None:
    """Fill the box of `clear`, which holds the background.

    Sub-pixel places follow the golden sequence in the plane, and instants are evenly spaced. Both are shifted at random in each pixel, by
    three draws, so that together they are even over pixel and exposure.
    """
    corners, instants, faces, lights = rays.corners, rays.instants, surface.faces, surface.lights
    n = np.int32(round(math.sqrt(len(faces) / 6)))
    half = np.float32(0.5 * n)
    shine, around, unit = np.float32(surface.gloss), np.float32(surface.ambient), np.float32(1.0 / LEVELS)
    across = corners[0, 1, 0] - corners[0, 0, 0]
    skip = (1.01 * rays.spread / instants[CZ] + 2.0 * across) ** 2
    work, texel = np.empty(7 * SAMPLES, dtype=np.float32), np.empty(SAMPLES, dtype=np.int32)
    draw = 0
    for row in range(box.v1 - box.v0):
        for column in range(box.u1 - box.u0):
            x0, xu, xv = _pixel(corners, row, column, 0)
            y0, yu, yv = _pixel(corners, row, column, 1)
            shift_u, shift_v = unit * np.float32(draws[draw]), unit * np.float32(draws[draw + 1])
            first = draws[draw + 2] % SAMPLES
            draw += 3
            if x0 * x0 + y0 * y0 > skip:
                continue  # two pixels beside the blurred ball
            background = clear[box.v0 + row, box.u0 + column]
            xa, xb, xc, ya, yb, yc = np.float32(x0), np.float32(xu), np.float32(xv), np.float32(y0), np.float32(yu), np.float32(yv)
            now = instants[first:]
            for i in range(SAMPLES):
                u, v = shift_u + GOLDEN[0, i], shift_v + GOLDEN[1, i]
                u -= ONE if u >= ONE else ZERO
                v -= ONE if v >= ONE else ZERO
                x, y = xa + u * xb + v * xc, ya + u * yb + v * yc  # the ray is (x, y, 1)
                px, py = x * now[CZ + i] - now[CX + i], y * now[CZ + i] - now[CY + i]  # from the centre to where it passes there
                square, slope = ONE + x * x + y * y, px * x + py * y
                gap = slope * slope - square * (px * px + py * py - ONE)
                nz = -(slope + math.sqrt(max(gap, ZERO))) / square
                nx, ny = px + nz * x, py + nz * y
                bx = now[R00 + i] * nx + now[R01 + i] * ny + now[R02 + i] * nz
                by = now[R10 + i] * nx + now[R11 + i] * ny + now[R12 + i] * nz
                bz = now[R20 + i] * nx + now[R21 + i] * ny + now[R22 + i] * nz
                on_x, on_y = (abs(bx) >= abs(by)) & (abs(bx) >= abs(bz)), abs(by) >= abs(bz)
                a = by if on_x else (bz if on_y else bx)
                b = bz if on_x else (bx if on_y else by)
                c = bx if on_x else (by if on_y else bz)
                face = (np.int32(0) if on_x else (np.int32(2) if on_y else np.int32(4))) + np.int32(c < ZERO)
                scale = half / abs(c)
                at_a, at_b = min(n - np.int32(1), np.int32(a * scale + half)), min(n - np.int32(1), np.int32(b * scale + half))
                texel[i] = (face * n + at_a) * n + at_b
                work[NX + i], work[NY + i], work[NZ + i] = nx, ny, nz
                work[DX + i], work[DY + i], work[GAP + i] = x, y, gap
            total = ZERO
            for i in range(SAMPLES):
                work[ALBEDO + i] = faces[texel[i]]
            for i in range(SAMPLES):
                grey = around * work[ALBEDO + i] if work[GAP + i] > ZERO else background
                total += grey
            for k in range(len(lights)):
                for i in range(SAMPLES):
                    nx, ny, nz, x, y = work[NX + i], work[NY + i], work[NZ + i], work[DX + i], work[DY + i]
                    lx = lights[k, 0] - now[CX + i] - nx  # from the surface to the lamp
                    ly = lights[k, 1] - now[CY + i] - ny
                    lz = lights[k, 2] - now[CZ + i] - nz
                    near, sight = ONE / (lx * lx + ly * ly + lz * lz), ONE / math.sqrt(ONE + x * x + y * y)
                    facing = (nx * lx + ny * ly + nz * lz) * math.sqrt(near)
                    away = (lx * x + ly * y + lz) * math.sqrt(near) * sight
                    lobe = facing - (nx * x + ny * y + nz) * sight  # on the normal, of the vector half way between lamp and eye
                    lobe = lobe * lobe / (TWO - TWO * away)
                    for _ in range(SHARPNESS - 1):
                        lobe *= lobe
                    grey = lights[k, STRENGTH] * near * (work[ALBEDO + i] * facing + shine * lobe)
                    total += grey if (facing > ZERO) & (work[GAP + i] > ZERO) else ZERO
            clear[box.v0 + row, box.u0 + column] = total / np.float32(SAMPLES)


@njit(cache=True, nogil=True)
def _blur(clear: np.ndarray, box: _Box, taps: np.ndarray) -> None:
    """Convolve the box, and the pixels that it reaches, with taps in both directions; the image is continued beyond its edges."""
    reach = len(taps) // 2
    height, width = clear.shape
    u0, u1, v0, v1 = max(0, box.u0 - reach), min(width, box.u1 + reach), max(0, box.v0 - reach), min(height, box.v1 + reach)
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose(image: np.ndarray, clear: np.ndarray, draws: np.ndarray, full_scale: float, read: float, gamma: float, top: int) -> None:
    """Add shot and read noise as one normal draw, apply gamma, and round; image, clear and draws have one length."""
    shot, floor, most = np.float32(1.0 / full_scale), np.float32((read / full_scale) ** 2), np.float32(top)
    for i in range(len(clear)):
        clear[i] += NORMAL_DRAWS[draws[i]] * math.sqrt(max(ZERO, clear[i]) * shot + floor)
    if gamma != 1.0:
        for i in range(len(clear)):
            clear[i] = max(ZERO, clear[i]) ** np.float32(1.0 / gamma)
    for i in range(len(clear)):
        image[i] = np.int32(min(most, max(ZERO, most * clear[i] + HALF)))
