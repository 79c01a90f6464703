"""A second look at a burst, once its spin is known: at the light, which shines from marks and white alike, and at the outline.

What lies along the outline in one image is seen better in others, before or after it has turned there. So the brightness just inside can be
expected, mark by mark, and the outline is where the image falls to half of it, blurred: with marks there it is 0.1 pixels off without this.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.failures import Failure
from tt_core.states import Array

from ..camera import Camera, project_point, ray
from ..detection.ball_detection import BLUR, RAYS, SMOOTH, Image, Spot, bilinear
from ..detection.illumination import level
from ..motion_fit import FINE, Motion, refit
from .registration import Registration, SearchParams, again, turned
from .sphere_grid import cube, nearest
from .surface_map import Surface

EDGE = 96  # texels along the edge of the cube that finds the marks at a place on the ball
KNOWN = 0.3  # weight, of 1 for a pixel seen straight on, on which a mark must rest
KEPT = 0.8  # of what a camera shows, that it must show under the light of the marks: 0.94 and more is usual, with marks of another ball 0
DEPTHS = 14  # samples inside the outline, STEP apart, the first one half a step inside
STEP = 0.5  # pixels
NEAR, DEEP = 1.5, 6.0  # pixels inside the outline between which image and expectation are compared
BENT = 0.003  # weight of the prior that the light at the outline is as expected, not brighter or darker towards it; of lamps it is known
MIDDLE = 0.45  # cosine to the line of sight half way between NEAR and DEEP


def look_again(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    times: Array,
    cameras: Sequence[Camera],
    surface: Surface,
    found: Registration,
    motion: Motion,
    search: SearchParams,
) -> tuple[Surface, Registration, Motion] | Failure:
    """Surface, spin and motion, better known. frames, spots: [camera][frame]. times: (frames,) s.
    Returns the reason when it finds no outline."""
    texels, light = cube(len(found.marks), EDGE), surface.light
    turns = turned(found.spin, surface.views, surface.frame, surface.times)
    if not light.known:
        relit = surface.lit(light.again(surface.stack, surface.normals, _painted(surface.normals, turns, found.marks, texels)))
        if (_shown(relit, len(cameras)) > KEPT * _shown(surface, len(cameras))).all():
            surface, light = relit, relit.light
            found = again(surface, found, search, math.inf)
            turns = turned(found.spin, surface.views, surface.frame, surface.times)
    expected = _limb(turns, surface.views, found.marks, texels, light.harmonics, light.gloss, light.gains, light.lamps)
    rows, count = [], len(times)
    centres = surface.views[:, 9:12]
    for m, (camera, centre) in enumerate(zip(np.repeat(np.array(cameras, dtype=object), count), centres, strict=True)):
        c, k = divmod(m, count)
        u, v = project_point(camera.vector, *centre)
        radius = camera.focal_pixels * BALL_RADIUS / centre[2]
        edge = _outline(
            frames[c][k], u, v, radius, spots[c][k].peak - spots[c][k].background, expected[m], math.inf if light.known else BENT
        )
        rows.append(np.hstack([np.full((len(edge), 1), c), np.full((len(edge), 1), k), edge]))
    moved = refit(motion, np.concatenate(rows), times, cameras, light.known)
    if isinstance(moved, Failure):
        return moved
    surface = surface.at(moved.positions(times), moved.alignment, cameras)
    return surface, again(surface, found, search), moved


def _shown(surface: Surface, cameras: int) -> Array:
    """(cameras,) how much of the ball each camera shows well enough."""
    return np.asarray(surface.marks[..., 1].reshape(cameras, -1).sum(axis=1, dtype=np.float64))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _mark(nx: float, ny: float, nz: float, turns: Array, m: int, marks: Array, texels: np.ndarray, least: float) -> float:
    """The mark at the normal (nx, ny, nz) in the frame of the camera of image m; -1 where it rests on less than `least`."""
    x = turns[m, 0, 0] * nx + turns[m, 1, 0] * ny + turns[m, 2, 0] * nz
    y = turns[m, 0, 1] * nx + turns[m, 1, 1] * ny + turns[m, 2, 1] * nz
    z = turns[m, 0, 2] * nx + turns[m, 1, 2] * ny + turns[m, 2, 2] * nz
    i = nearest(texels, x, y, z)
    return min(1.1, max(0.0, marks[i, 0])) if marks[i, 1] > least else -1.0


@njit(cache=True, nogil=True)
def _painted(normals: np.ndarray, turns: Array, marks: Array, texels: np.ndarray) -> np.ndarray:
    """(images, size, size) float32, the marks in every third pixel of every third row, as `Light.again` takes them; 0 where not known."""
    out, size = np.zeros(normals.shape[:3], dtype=np.float32), normals.shape[1]
    for m in range(len(normals)):
        for j in range(m % 3, size, 3):
            for i in range(m % 3, size, 3):
                if normals[m, j, i, 3] > 0.0:
                    mark = _mark(normals[m, j, i, 0], normals[m, j, i, 1], -normals[m, j, i, 2], turns, m, marks, texels, KNOWN)
                    out[m, j, i] = max(0.0, mark)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _limb(
    turns: Array, views: Array, marks: Array, texels: np.ndarray, harmonics: Array, gloss: Array, gains: Array, lamps: Array
) -> Array:
    """(images, RAYS, DEPTHS) grey levels expected just inside the outline; white where no image shows what is there."""
    images, cameras = len(views), len(harmonics)
    out = np.empty((images, RAYS, DEPTHS))
    for m in range(images):
        c = m * cameras // images
        view, of, adds, lit = views[m], harmonics[c], gloss[c], lamps[c]
        cx, cy, cz = view[9], view[10], view[11]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        u, v = project_point(view, cx, cy, cz)
        radius = view[12] * BALL_RADIUS / cz
        for k in range(RAYS):
            du, dv = math.cos(2.0 * math.pi * k / RAYS), math.sin(2.0 * math.pi * k / RAYS)
            for d in range(DEPTHS):
                s = radius - STEP * (d + 0.5)
                x, y = ray(view, u + s * du, v + s * dv)
                z = 1.0 / math.sqrt(x * x + y * y + 1.0)
                x, y = x * z, y * z
                along = x * cx + y * cy + z * cz
                reach = along - math.sqrt(max(0.0, along * along - square))
                nx, ny, nz = (reach * x - cx) / BALL_RADIUS, (reach * y - cy) / BALL_RADIUS, (reach * z - cz) / BALL_RADIUS
                mark = _mark(nx, ny, nz, turns, m, marks, texels, 0.05)
                white = level(nx, ny, -nz, cx, cy, cz, of, lit)
                shine = adds[0] + nx * adds[1] + ny * adds[2] - nz * adds[3]
                out[m, k, d] = max(0.0, gains[m] * ((1.0 if mark < 0.0 else mark) * white + shine))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _outline(image: np.ndarray, u: float, v: float, radius: float, contrast: float, expected: Array, bent: float) -> Array:
    """(n, 3) pixel and weight of outline points around (u, v), as `centre.outline`, by what is expected inside: (RAYS, DEPTHS).

    Image and expectation are compared NEAR to DEEP inside the outline: their ratio, and how it bends towards the outline, scale what is
    expected there; blurred, half of it is the threshold.
    """
    outer, fine = radius + FINE, 0.5
    count = int((2.0 * FINE + DEEP) / fine) + 1
    height, width = image.shape
    profile, points, found = np.empty(count), np.empty((RAYS, 3)), 0
    near, total = np.empty(6), 0.0
    for d in range(6):
        near[d] = math.exp(-0.5 * (STEP * (d + 0.5) / BLUR) ** 2)
        total += near[d]
    for k in range(RAYS):
        du, dv = math.cos(2.0 * math.pi * k / RAYS), math.sin(2.0 * math.pi * k / RAYS)
        if not (0.0 <= u + outer * du < width - 1 and 0.0 <= v + outer * dv < height - 1):
            continue
        for i in range(count):
            s = outer - fine * i
            profile[i] = bilinear(image, u + s * du, v + s * dv)
        behind = 0.25 * (profile[0] + profile[1] + profile[2] + profile[3])
        edge, seen, ragged, bright = radius, False, 0.0, 0.0
        for _ in range(3):
            n, xx, xy, yy, zz, xz, zy = 0, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(max(0, math.ceil((outer - edge + NEAR) / fine)), min(count, int((outer - edge + DEEP) / fine) + 1)):
                depth = fine * i - outer + edge
                at = max(0.0, depth / STEP - 0.5)
                d = min(DEPTHS - 2, int(at))
                x = expected[k, d] + (at - d) * (expected[k, d + 1] - expected[k, d])
                y, z = profile[i] - behind, x * (math.sqrt(2.0 * depth / radius) - MIDDLE)
                n, xx, xy, yy, zz, xz, zy = n + 1, xx + x * x, xy + x * y, yy + y * y, zz + z * z, xz + x * z, zy + z * y
            zz += bent * xx
            bend = (zy - xz * xy / xx) / (zz - xz * xz / xx)
            ratio = (xy - bend * xz) / xx
            seen = n >= 4 and ratio > 0.2
            if not seen:
                break
            bright = 0.0
            for d in range(6):
                cosine = math.sqrt(2.0 * STEP * (d + 0.5) / radius)
                bright += near[d] * expected[k, d] * max(0.0, ratio + bend * (cosine - MIDDLE)) / total
            ragged = math.sqrt(max(0.0, yy - ratio * xy - bend * zy) / max(yy, 1e-9))
            threshold, closest = behind + 0.5 * bright, np.inf
            for i in range(1, count):
                if profile[i - 1] < threshold <= profile[i]:
                    s = outer - fine * (i - (profile[i] - threshold) / (profile[i] - profile[i - 1]))
                    if abs(s - radius) < closest:
                        closest, edge = abs(s - radius), s
            seen = closest < 3.0 and bright > 0.15 * contrast
            if not seen:
                break
        if seen:
            points[found, 0], points[found, 1] = u + edge * du, v + edge * dv
            points[found, 2] = min(1.0, bright / (0.5 * contrast)) / (1.0 + (ragged / (1.5 * SMOOTH)) ** 2) ** 2
            found += 1
    return points[:found].copy()
