"""From grey levels to marks: where each pixel lies on the ball, and the light divided out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from .camera import Camera, project_point, ray
from .centre import Image

LIMB = 0.30  # cosine to the line of sight below which a pixel is not used: two pixels inside the outline
FULL = 0.55  # and above which it counts fully
WHITE = 0.85  # of the fitted light: darker pixels are marks
DIM = 0.15  # of the brightest light: below it marks drown in noise
BORDER = 4  # pixels around the ball that are cut out with it
HARMONICS = 9  # spherical harmonics up to second order hold all but 1 % of diffuse light on a sphere (Ramamoorthi, Hanrahan 2001)
DULL = 0.02  # variance of the marks, relative to white, below which the ball is taken as bare; 13 % of marks give 0.08


@dataclass(frozen=True, eq=False)
class Surface:
    """The ball's surface in every image of a burst, light divided out: white is 1, marks near 0.

    marks, soft: (images, n, n) float32, cut out around the ball; `soft` is blurred, for coarse search. weights: (images, n, n), 0 where
    nothing is known. corners: (images, 2) pixel of each cut's first element. centres: (images, 3) m, ball in its camera's frame, aligned
    to its outline. camera, frame: (images,) which. vectors: (cameras, 20). times: (frames,) s from the middle of the burst.
    contrast: variance of the marks.
    """

    marks: np.ndarray
    soft: np.ndarray
    weights: np.ndarray
    corners: Array
    centres: Array
    camera: np.ndarray
    frame: np.ndarray
    vectors: Array
    times: Array
    contrast: float


def unwrap(
    frames: Sequence[Sequence[Image]], backgrounds: Array, positions: Array, offsets: Array, times: Array, cameras: Sequence[Camera]
) -> Surface:
    """frames: [camera][frame]. backgrounds: (cameras, frames) grey levels. positions: (frames, 3) m. offsets: (cameras, 2) pixels."""
    vectors = np.array([camera.vector for camera in cameras])
    centres, corners, index, cuts, level = [], [], [], [], []
    for c, camera in enumerate(cameras):
        for k, position in enumerate(positions):
            at = camera.rotation @ position + camera.translation
            at[:2] += offsets[c] * at[2] / camera.focal_pixels
            centres.append(at)
            index.append((c, k))
    at = np.array(centres)
    size = 2 * (math.ceil(max(vectors[c, 12] * BALL_RADIUS / z for (c, _), z in zip(index, at[:, 2], strict=True))) + BORDER) + 1
    for (c, k), p in zip(index, at, strict=True):
        u, v = project_point(vectors[c], p[0], p[1], p[2])
        image = frames[c][k]
        corner = (round(u) - size // 2, round(v) - size // 2)
        corners.append(corner)
        cuts.append(_cut(image, corner, size))
        level.append(backgrounds[c, k])
    camera_of, frame_of = np.array(index).T
    stack, corner_of = np.array(cuts, dtype=np.float32), np.array(corners, dtype=np.float64)
    stack -= np.array(level, dtype=np.float32)[:, None, None]
    top = np.float32(stack.max())
    normals = _normals(stack.shape[1], corner_of, at, camera_of, vectors)
    light, gains = _fit_light(stack, normals)
    marks, weights = _divide(stack, normals, light, gains, top)
    soft = np.empty_like(marks)
    for m in range(len(marks)):
        mass = cv2.GaussianBlur(weights[m], (0, 0), 2.0)
        soft[m] = cv2.GaussianBlur(marks[m] * weights[m], (0, 0), 2.0) / np.maximum(mass, 1e-3)
    mean = float((marks * weights).sum() / max(weights.sum(), 1e-6))
    contrast = float((weights * (marks - mean) ** 2).sum() / max(weights.sum(), 1e-6))
    return Surface(marks, soft, weights, corner_of, at, camera_of, frame_of, vectors, np.asarray(times, dtype=np.float64), contrast)


def _cut(image: Image, corner: tuple[int, int], size: int) -> Image:
    """(size, size) of the image, its edge continued outside."""
    u, v = corner
    height, width = image.shape
    if u >= 0 and v >= 0 and u + size <= width and v + size <= height:
        return image[v : v + size, u : u + size]
    return image[np.clip(np.arange(v, v + size), 0, height - 1)[:, None], np.clip(np.arange(u, u + size), 0, width - 1)]


@njit(cache=True, nogil=True)
def _normals(size: int, corners: Array, centres: Array, camera_of: np.ndarray, vectors: Array) -> np.ndarray:
    """(images, size, size, 4) float32: outward unit normal in `table` and its cosine to the line of sight; cosine 0 off the ball."""
    out = np.zeros((len(corners), size, size, 4), dtype=np.float32)
    for m in range(len(corners)):
        camera = vectors[camera_of[m]]
        cx, cy, cz = centres[m]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        for j in range(size):
            for i in range(size):
                x, y = ray(camera, corners[m, 0] + i, corners[m, 1] + j)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                dx, dy, dz = x * scale, y * scale, scale
                along = dx * cx + dy * cy + dz * cz
                gap = along * along - square
                if gap <= 0.0:
                    continue
                root = math.sqrt(gap)
                reach = along - root
                nx, ny, nz = (reach * dx - cx) / BALL_RADIUS, (reach * dy - cy) / BALL_RADIUS, (reach * dz - cz) / BALL_RADIUS
                out[m, j, i, 0] = camera[0] * nx + camera[3] * ny + camera[6] * nz
                out[m, j, i, 1] = camera[1] * nx + camera[4] * ny + camera[7] * nz
                out[m, j, i, 2] = camera[2] * nx + camera[5] * ny + camera[8] * nz
                out[m, j, i, 3] = root / BALL_RADIUS
    return out


@njit(cache=True, nogil=True)
def _harmonics(x: float, y: float, z: float, out: Array) -> None:
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6], out[7], out[8] = x * y, y * z, z * x, x * x - y * y, 3.0 * z * z - 1.0


@njit(cache=True, nogil=True)
def _fit_light(stack: np.ndarray, normals: np.ndarray) -> tuple[Array, Array]:
    """(9,) light on a white surface by its normal, and (images,) gain of each image; marks are left out step by step."""
    images, size = stack.shape[0], stack.shape[1]
    light, gains, h = np.zeros(HARMONICS), np.ones(images), np.empty(HARMONICS)
    for step in range(6):
        a, b = np.zeros((HARMONICS, HARMONICS)), np.zeros(HARMONICS)
        above, under = np.zeros(images), np.full(images, 1e-9)
        for m in range(images):
            for j in range(m % 3, size, 3):
                for i in range(m % 3, size, 3):
                    if normals[m, j, i, 3] < LIMB:
                        continue
                    _harmonics(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                    value = stack[m, j, i]
                    if step > 0:
                        expected = gains[m] * (light @ h)
                        if value < WHITE * expected or (step > 2 and value > expected / WHITE):
                            continue
                        above[m] += value
                        under[m] += expected / gains[m]
                    for p in range(HARMONICS):
                        b[p] += gains[m] * value * h[p]
                        for q in range(p + 1):
                            a[p, q] += gains[m] ** 2 * h[p] * h[q]
        for p in range(HARMONICS):
            a[p, p] *= 1.0 + 1e-4
            a[p, p] += 1e-6
            for q in range(p):
                a[q, p] = a[p, q]
        light = np.linalg.solve(a, b)
        if step > 1:
            gains = above / under
            gains /= gains.mean()
    return light, gains


@njit(cache=True, nogil=True)
def _divide(stack: np.ndarray, normals: np.ndarray, light: Array, gains: Array, top: float) -> tuple[np.ndarray, np.ndarray]:
    images, size = stack.shape[0], stack.shape[1]
    marks, weights = np.ones(stack.shape, dtype=np.float32), np.zeros(stack.shape, dtype=np.float32)
    h = np.empty(HARMONICS)
    for m in range(images):
        for j in range(size):
            for i in range(size):
                cosine = normals[m, j, i, 3]
                if cosine <= 0.05:
                    continue
                _harmonics(normals[m, j, i, 0], normals[m, j, i, 1], normals[m, j, i, 2], h)
                expected = gains[m] * (light @ h) / top
                if expected < DIM:
                    continue
                marks[m, j, i] = min(1.5, max(-0.3, stack[m, j, i] / top / expected))
                seen = min(1.0, max(0.0, (cosine - LIMB) / (FULL - LIMB)))
                weights[m, j, i] = seen * seen * (3.0 - 2.0 * seen) * min(1.0, (expected / 0.5) ** 2)
    return marks, weights
