"""Method 2 of the dissertation (Section 2.4), kept unchanged in order to measure how fast a machine is.

Machines differ threefold in speed, so the benchmarks report their times as shares of the time of this one. It uses nothing of this project,
and it must not change: `HASH` in `latency.py` is compared with its contents, by the benchmark and by a test.

A burst is two arrays of images, their times, and both cameras as arrays (20,): rotation from the table's frame by rows, translation (m),
focal length and principal point (pixels), the five distortion coefficients of OpenCV.
"""

import math

import numpy as np
from numba import njit

RADIUS = 0.02  # m, of the ball
RPM = 2.0 * math.pi / 60.0  # rad/s
DEPTH = 0.25  # threshold between background and brightest part of the ball, relative
CAMERA = 1  # "say Camera 2"
START = (577.35, -577.35, 577.35)  # rpm
STEP, LEAST_STEP = 20.0, 0.5  # alpha_0^0, alpha_min
ENOUGH, FLAT = 1000.0, 3.0  # E_min, g_max
SEARCHES, DIRECTIONS = 4, 6  # q_max, h_max
DIFFERENCE = 10.0  # rad/s, of the central difference
DESCENT, CURVATURE = 0.1, 0.7  # Wolfe-Powell
UNDISTORT_STEPS = 8
PASSES = 3  # of the triangulation


def method_2(images, times, cameras):
    """Return the spin (3,) rad/s in the table's frame.

    Args:
        images: Two arrays (k, h, w) uint8 or uint16.
        times: (k,) s.
        cameras: (2, 20).
    """
    pixels = np.array([[four_points(image, threshold_of(image)) for image in stack] for stack in images])
    positions = triangulate(cameras, pixels)
    camera = cameras[CAMERA]
    rotation, translation = camera[:9].reshape(3, 3), camera[9:12]
    centres = positions @ rotation.T + translation
    own = images[CAMERA]
    full = max(255.0, 2.0 ** math.ceil(math.log2(float(own.max()) + 1.0)) - 1.0)
    stack = np.float32(255.0 / full) * own.astype(np.float32)
    half = 0.5 * math.sqrt(2.0) * camera[12] * RADIUS / float(centres[:, 2].mean())
    arms, greys = inscribed_square(stack, pixels[CAMERA], centres, camera, half)

    def objective(spin):
        return difference(rotation @ spin, arms, greys, stack, centres, times, camera)

    def gradient(spin):
        return np.array([(objective(spin + e) - objective(spin - e)) / (2.0 * DIFFERENCE) for e in DIFFERENCE * np.eye(3)])

    spin = RPM * np.array(START)
    error, g, direction, step = objective(spin), gradient(spin), np.zeros(3), STEP
    before = g
    for h in range(DIRECTIONS):
        beta = 0.0 if h == 0 else min(1.0, max(0.0, float(g @ (g - before)) / max(float(before @ before), 1e-12)))
        direction = -g + beta * direction
        slope = float(g @ direction)
        if slope >= 0.0:
            direction, slope = -g, -float(g @ g)
        low, high = 0.0, math.inf
        for _ in range(SEARCHES):
            trial = spin + step * direction
            trial_error = objective(trial)
            if trial_error > error + DESCENT * step * slope:
                high = step
            else:
                if gradient(trial) @ direction >= CURVATURE * slope:
                    break
                low = step
            step = 2.0 * low if high == math.inf else 0.5 * (low + high)
            if step < LEAST_STEP:
                break
        if trial_error < error:
            before, spin, error = g, trial, trial_error
            g = gradient(spin)
        if step < LEAST_STEP or (error < ENOUGH and np.linalg.norm(g) < FLAT):
            break
    return spin


def threshold_of(image):
    """Return the grey level between the background, the median, and the level that one pixel in a thousand exceeds."""
    counts = np.cumsum(np.bincount(image[::2, ::2].ravel()))
    background, peak = np.searchsorted(counts, (0.5 * counts[-1], 0.999 * counts[-1]))
    return background + DEPTH * (peak - background)


def four_points(image, threshold):
    """Return the middle (2,) pixel of a ball from four points of its outline, (2.5) to (2.10)."""
    over = image > threshold
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    top, bottom, left, right = rows[0], rows[-1], columns[0], columns[-1]
    points = np.array(
        [
            (np.flatnonzero(over[top])[0], top),
            (right, np.flatnonzero(over[:, right])[0]),
            (np.flatnonzero(over[bottom])[-1], bottom),
            (left, np.flatnonzero(over[:, left])[-1]),
        ],
        dtype=np.float64,
    )
    chords = np.roll(points, -1, axis=0) - points
    chords /= np.maximum(np.linalg.norm(chords, axis=1, keepdims=True), 1e-9)
    middles = (points + np.roll(points, -1, axis=0)) / 2
    return np.linalg.lstsq(chords, (chords * middles).sum(axis=1), rcond=None)[0]


def triangulate(cameras, pixels):
    """Return the points (k, 3) m that the cameras (2, 20) see at pixels (2, k, 2): linear (B.74), rows scaled by depth."""
    points = np.empty((pixels.shape[1], 3))
    for i in range(len(points)):
        rays = [ray(optics_of(camera), *pixels[c, i]) for c, camera in enumerate(cameras)]
        depths = [1.0, 1.0]
        for _ in range(PASSES):
            rows, right = [], []
            for camera, sight, depth in zip(cameras, rays, depths, strict=True):
                r, t = camera[:9].reshape(3, 3), camera[9:12]
                for a in range(2):
                    rows.append((sight[a] * r[2] - r[a]) / depth)
                    right.append((t[a] - sight[a] * t[2]) / depth)
            a = np.array(rows)
            points[i] = np.linalg.solve(a.T @ a, a.T @ np.array(right))
            depths = [float(camera[6:9] @ points[i] + camera[11]) for camera in cameras]
    return points


@njit(cache=True, nogil=True)
def optics_of(camera):
    """Return focal length, principal point and distortion as numbers."""
    return camera[12], camera[13], camera[14], camera[15], camera[16], camera[17], camera[18], camera[19]


@njit(cache=True, nogil=True)
def distort(optics, x, y):
    """Return the distorted X/Z and Y/Z, OpenCV's polynomial."""
    _, _, _, k1, k2, p1, p2, k3 = optics
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)


@njit(cache=True, nogil=True)
def project(optics, x, y, z):
    """Return the pixel of a point in the camera's frame."""
    a, b = distort(optics, x / z, y / z)
    return optics[0] * a + optics[1], optics[0] * b + optics[2]


@njit(cache=True, nogil=True)
def ray(optics, u, v):
    """Return X/Z and Y/Z of the ray through a pixel."""
    x0, y0 = (u - optics[1]) / optics[0], (v - optics[2]) / optics[0]
    x, y = x0, y0
    if optics[3] != 0.0 or optics[4] != 0.0 or optics[5] != 0.0 or optics[6] != 0.0 or optics[7] != 0.0:
        for _ in range(UNDISTORT_STEPS):
            a, b = distort(optics, x, y)
            x, y = x + x0 - a, y + y0 - b
    return x, y


@njit(cache=True, nogil=True)
def rotation_matrix(v):
    """Return the rotation (3, 3) by the rotation vector v (3,) rad."""
    angle2 = float(v @ v)
    angle = math.sqrt(angle2)
    a, b = 1.0, 0.5
    if angle > 1e-9:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    k = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + a * k + b * (k @ k)


@njit(cache=True, nogil=True)
def inscribed_square(stack, pixels, centres, camera, half):
    """Return arms (k, n, 3) m to the surface, NaN behind the last pixel, and grey levels (k, n), of the square inscribed in the ball."""
    optics, side = optics_of(camera), int(2.0 * half) + 2
    arms, greys = np.full((len(stack), side * side, 3), np.nan), np.zeros((len(stack), side * side))
    for k in range(len(stack)):
        cx, cy, cz = centres[k]
        square = cx * cx + cy * cy + cz * cz - RADIUS**2
        n = 0
        for j in range(max(0, math.ceil(pixels[k, 1] - half)), min(stack.shape[1], int(pixels[k, 1] + half) + 1)):
            for i in range(max(0, math.ceil(pixels[k, 0] - half)), min(stack.shape[2], int(pixels[k, 0] + half) + 1)):
                x, y = ray(optics, i, j)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                along = (x * cx + y * cy + cz) * scale
                gap = along * along - square
                if gap > 0.0:
                    reach = (along - math.sqrt(gap)) * scale
                    arms[k, n, 0], arms[k, n, 1], arms[k, n, 2] = reach * x - cx, reach * y - cy, reach - cz
                    greys[k, n] = stack[k, j, i]
                    n += 1
    return arms, greys


@njit(cache=True, nogil=True)
def difference(spin, arms, greys, stack, centres, times, camera):
    """Return E (2.32), squared grey levels, of each frame turned on by a spin (3,) rad/s against the next one."""
    optics, height, width = optics_of(camera), stack.shape[1], stack.shape[2]
    nearest, value = np.empty((height, width)), np.empty((height, width))
    total = 0.0
    for k in range(len(times) - 1):
        turn = rotation_matrix(spin * (times[k + 1] - times[k]))
        xx, xy, xz, yx, yy, yz = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
        zx, zy, zz = turn[2, 0], turn[2, 1], turn[2, 2]
        cx, cy, cz = centres[k + 1]
        u, v = project(optics, cx, cy, cz)
        reach = optics[0] * RADIUS / cz + 3.0
        u0, u1 = max(0, int(u - reach)), min(width, int(u + reach) + 1)
        v0, v1 = max(0, int(v - reach)), min(height, int(v + reach) + 1)
        nearest[v0:v1, u0:u1] = 1.0
        for n in range(arms.shape[1]):
            x, y, z = arms[k, n, 0], arms[k, n, 1], arms[k, n, 2]
            if math.isnan(x):
                break
            dx, dy, dz = xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z
            u, v = project(optics, cx + dx, cy + dy, cz + dz)
            for j in range(max(v0, math.ceil(v - 1.0)), min(v1, int(v + 1.0) + 1)):
                for i in range(max(u0, math.ceil(u - 1.0)), min(u1, int(u + 1.0) + 1)):
                    square = (i - u) ** 2 + (j - v) ** 2
                    if square < nearest[j, i]:
                        nearest[j, i], value[j, i] = square, greys[k, n]
        count, error = 0, 0.0
        for j in range(v0, v1):
            for i in range(u0, u1):
                if nearest[j, i] < 1.0:
                    count += 1
                    error += (value[j, i] - stack[k + 1, j, i]) ** 2
        total += error / max(count, 1)
    return total / (len(times) - 1)
