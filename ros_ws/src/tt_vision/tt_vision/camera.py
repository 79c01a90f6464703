"""The pinhole camera: projection (2.3), (2.4), triangulation (B.72) to (B.76), calibration from known points (B.66) to (B.71)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from tt_core.errors import BadShape, TtError, check_array, check_range
from tt_core.states import Array

UNDISTORT_STEPS = 8  # fixed-point steps; 1e-9 px for lenses with |k1| < 0.3 inside the views used here


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that looks along its z axis, x to the right and y down in the image.

    rotation: (3, 3) and translation: (3,) m, p_camera = rotation @ p_table + translation (2.3). focal_length, pixel_size: m.
    width, height: pixels; pixel (0, 0) has its centre at (0.0, 0.0). principal_point: (2,) pixels, the middle of the image by default.
    distortion: k1, k2, p1, p2 and k3 if wanted, as in OpenCV. Raises a TtError for anything not finite or not a rotation.
    """

    rotation: Array
    translation: Array
    focal_length: float
    pixel_size: float
    width: int
    height: int
    principal_point: Array | None = None
    distortion: Array | None = None

    def __post_init__(self) -> None:
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        distortion = np.zeros(5) if self.distortion is None else np.ravel(np.array(self.distortion, dtype=np.float64))
        if len(distortion) not in (4, 5):
            raise BadShape("distortion", distortion.shape, "(4,) or (5,)")
        checked = {
            "rotation": check_array("rotation", self.rotation, (3, 3)),
            "translation": check_array("translation", self.translation, (3,)),
            "focal_length": check_range("focal_length", self.focal_length, 1e-6, 10.0),
            "pixel_size": check_range("pixel_size", self.pixel_size, 1e-8, 1e-2),
            "width": int(check_range("width", self.width, 1, 65535)),
            "height": int(check_range("height", self.height, 1, 65535)),
            "principal_point": check_array("principal_point", middle if self.principal_point is None else self.principal_point, (2,)),
            "distortion": check_array("distortion", np.append(distortion, np.zeros(5 - len(distortion))), (5,)),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(self.rotation) < 0.0:
            raise TtError(f"rotation is not a rotation matrix:\n{self.rotation}")

    @classmethod
    def looking_at(
        cls,
        position: Sequence[float] | Array,
        target: Sequence[float] | Array,
        up: Sequence[float] | Array = (0.0, 0.0, 1.0),
        *,
        focal_length: float,
        pixel_size: float,
        width: int,
        height: int,
    ) -> Camera:
        """A camera at `position` with `target` in the middle of its image and `up` upwards; all (3,) in `table`, m."""
        position = check_array("position", position, (3,))
        z = check_array("target", target, (3,)) - position
        z = z / check_range("distance to the target", float(np.linalg.norm(z)), 1e-9, math.inf)
        x = np.cross(z, check_array("up", up, (3,)))
        x = x / check_range("sine of the angle between view and up", float(np.linalg.norm(x)), 1e-9, math.inf)
        rotation = np.array([x, np.cross(z, x), z])
        return cls(rotation, -rotation @ position, focal_length, pixel_size, width, height)

    @classmethod
    def from_matrix(
        cls, rotation: Array, translation: Array, matrix: Array, width: int, height: int, distortion: Array | None, pixel_size: float
    ) -> Camera:
        """From K (3, 3) in pixels, whose two focal lengths must agree: pixels are square. pixel_size: m, only scales focal_length."""
        fx, fy = matrix[0, 0], matrix[1, 1]
        check_range("fx / fy", fx / fy if fy else math.inf, 0.99, 1.01)
        return cls(rotation, translation, 0.5 * (fx + fy) * pixel_size, pixel_size, width, height, matrix[:2, 2], distortion)

    @property
    def position(self) -> Array:
        """(3,) m, the pinhole in `table`."""
        return -self.rotation.T @ self.translation

    @property
    def focal_pixels(self) -> float:
        return self.focal_length / self.pixel_size

    @property
    def matrix(self) -> Array:
        """(3, 3) K in pixels."""
        u, v = self.principal_point  # type: ignore[misc]
        return np.array([[self.focal_pixels, 0.0, u], [0.0, self.focal_pixels, v], [0.0, 0.0, 1.0]])

    @cached_property
    def vector(self) -> Array:
        """(20,) for the kernels: rotation by rows, translation, focal length in pixels, principal point, distortion."""
        head = [self.rotation.ravel(), self.translation, [self.focal_pixels]]
        return np.concatenate([*head, self.principal_point, self.distortion])

    def project(self, points: Array) -> Array:
        """points: (n, 3) m in `table`. Returns (n, 2) pixels, NaN for a point that is not in front of the camera."""
        return _project(self.vector, check_array("points", points, (-1, 3)))

    def rays(self, pixels: Array) -> Array:
        """pixels: (n, 2). Returns (n, 3) unit directions in the camera's frame, the distortion undone."""
        return _rays(self.vector, check_array("pixels", pixels, (-1, 2)))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def distort(x: float, y: float, k1: float, k2: float, p1: float, p2: float, k3: float) -> tuple[float, float]:
    """x, y: X/Z and Y/Z in the camera's frame. The polynomial model of OpenCV."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


@njit(cache=True, nogil=True)
def project_point(camera: Array, x: float, y: float, z: float) -> tuple[float, float]:
    """camera: Camera.vector. x, y, z: m in the camera's frame. Not validated."""
    a, b = distort(x / z, y / z, camera[15], camera[16], camera[17], camera[18], camera[19])
    return camera[12] * a + camera[13], camera[12] * b + camera[14]


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def ray(camera: Array, u: float, v: float) -> tuple[float, float]:
    """camera: Camera.vector. u, v: pixel. Returns X/Z and Y/Z in the camera's frame. Not validated."""
    x0, y0 = (u - camera[13]) / camera[12], (v - camera[14]) / camera[12]
    x, y = x0, y0
    if camera[15] != 0.0 or camera[16] != 0.0 or camera[17] != 0.0 or camera[18] != 0.0 or camera[19] != 0.0:
        for _ in range(UNDISTORT_STEPS):
            a, b = distort(x, y, camera[15], camera[16], camera[17], camera[18], camera[19])
            x, y = x + x0 - a, y + y0 - b
    return x, y


@njit(cache=True, nogil=True)
def project_from_table(camera: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Pixel and depth (m) of a point in `table`, m; NaN where it is not in front of the camera. camera: Camera.vector. Not validated."""
    depth = camera[6] * x + camera[7] * y + camera[8] * z + camera[11]
    if depth <= 0.0:
        return math.nan, math.nan, depth
    across = camera[0] * x + camera[1] * y + camera[2] * z + camera[9]
    down = camera[3] * x + camera[4] * y + camera[5] * z + camera[10]
    u, v = project_point(camera, across, down, depth)
    return u, v, depth


@njit(cache=True, nogil=True)
def _project(camera: Array, points: Array) -> Array:
    pixels = np.empty((len(points), 2))
    for i in range(len(points)):
        pixels[i, 0], pixels[i, 1], _ = project_from_table(camera, points[i, 0], points[i, 1], points[i, 2])
    return pixels


@njit(cache=True, nogil=True)
def _rays(camera: Array, pixels: Array) -> Array:
    rays = np.empty((len(pixels), 3))
    for i in range(len(pixels)):
        x, y = ray(camera, pixels[i, 0], pixels[i, 1])
        length = math.sqrt(x * x + y * y + 1.0)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / length, y / length, 1.0 / length
    return rays


def triangulate(cameras: Sequence[Camera], pixels: Array) -> Array:
    """The points that the cameras see at `pixels`.

    pixels: (cameras, n, 2), or (cameras, 2) of one point. Returns (n, 3), or (3,), m in `table`: the linear solution (B.74), each row
    scaled by the distance it implies so that the residuals are those of the image, twice over. Raises TtError for fewer than two cameras
    or rays that are parallel.
    """
    if len(cameras) < 2:
        raise TtError(f"{len(cameras)} cameras cannot triangulate")
    if np.ndim(pixels) == 2:
        return triangulate(cameras, np.asarray(pixels)[:, None])[0]
    seen = check_array("pixels", pixels, (len(cameras), -1, 2))
    points = _triangulate(np.array([camera.vector for camera in cameras]), seen)
    if not np.isfinite(points).all():
        raise TtError("the rays of the cameras are parallel")
    return points


@njit(cache=True, nogil=True)
def _triangulate(cameras: Array, pixels: Array) -> Array:
    """cameras: (m, 20) Camera.vector. pixels: (m, n, 2). Returns (n, 3), NaN for parallel rays."""
    m, points = len(cameras), np.empty((pixels.shape[1], 3))
    rays, depths = np.empty((m, 2)), np.empty(m)
    for i in range(len(points)):
        for j in range(m):
            rays[j] = ray(cameras[j], pixels[j, i, 0], pixels[j, i, 1])
            depths[j] = 1.0
        for _ in range(3):
            xx, xy, xz, yy, yz, zz, x, y, z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # normal equations and their right side
            for j in range(m):
                c = cameras[j]
                for k in range(2):
                    p = (rays[j, k] * c[6] - c[3 * k]) / depths[j]
                    q = (rays[j, k] * c[7] - c[3 * k + 1]) / depths[j]
                    r = (rays[j, k] * c[8] - c[3 * k + 2]) / depths[j]
                    b = (c[9 + k] - rays[j, k] * c[11]) / depths[j]
                    xx, xy, xz, yy, yz, zz = xx + p * p, xy + p * q, xz + p * r, yy + q * q, yz + q * r, zz + r * r
                    x, y, z = x + p * b, y + q * b, z + r * b
            f, g, h = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
            det = xx * f + xy * g + xz * h
            if det < 1e-14 * (xx + yy + zz) ** 3:
                points[i] = np.nan
                break
            points[i, 0] = (f * x + g * y + h * z) / det
            points[i, 1] = (g * x + (xx * zz - xz * xz) * y + (xy * xz - xx * yz) * z) / det
            points[i, 2] = (h * x + (xy * xz - xx * yz) * y + (xx * yy - xy * xy) * z) / det
            for j in range(m):
                depths[j] = cameras[j, 6] * points[i, 0] + cameras[j, 7] * points[i, 1] + cameras[j, 8] * points[i, 2] + cameras[j, 11]
    return points


def calibrate(
    points: Array,
    pixels: Array,
    *,
    width: int = 232,
    height: int = 232,
    pixel_size: float = 20e-6,
    focal_length: float | None = None,
    distortion: bool = False,
    method: str = "nonlinear",
) -> Camera:
    """The camera that sees known points where they were seen.

    points: (n, 3) m in `table`. pixels: (n, 2). width, height: pixels; the principal point is taken to be in the middle. pixel_size: m.
    focal_length: m; estimated when None. distortion: whether k1 and k2 are estimated.
    method: "nonlinear", pose (and what else is asked for) by least squares in the image (B.71), from the linear solution; "linear", that
    solution alone (Appendix B.2.4), for which six points that are not in one plane suffice. Raises TtError when the points do not.
    """
    if method not in ("nonlinear", "linear"):
        raise TtError(f"method {method!r} is neither 'nonlinear' nor 'linear'")
    points, pixels = check_array("points", points, (-1, 3)), check_array("pixels", pixels, (-1, 2))
    if len(points) != len(pixels):
        raise BadShape("pixels", pixels.shape, (len(points), 2))
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    rotation, translation, focal = _resection(points, pixels - middle, None if focal_length is None else focal_length / pixel_size)

    def camera(x: Array) -> Camera:
        turned = cv2.Rodrigues(x[:3])[0] @ rotation
        focal_length_now = focal_length if focal_length is not None else math.exp(x[6]) * pixel_size
        return Camera(
            turned, x[3:6], focal_length_now, pixel_size, width, height, None, np.append(x[7:9], [0.0, 0.0]) if distortion else None
        )

    start = np.concatenate([np.zeros(3), translation, [math.log(focal)], np.zeros(2)])
    if method == "linear":
        return camera(start)
    free = np.array([True] * 6 + [focal_length is None] + [distortion] * 2)

    def misses(x: Array) -> Array:
        full = start.copy()
        full[free] = x
        return (camera(full).project(points) - pixels).ravel()

    found = start.copy()
    found[free] = least_squares(misses, start[free], x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return camera(found)


def _resection(points: Array, pixels: Array, focal: float | None) -> tuple[Array, Array, float]:
    """(rotation, translation, focal length in pixels) from pixels counted from the principal point, linear: rows of (B.70) times depth."""
    if len(points) < 6:
        raise TtError(f"{len(points)} points cannot calibrate a camera, 6 needed")
    centre, scale = points.mean(axis=0), max(float(points.std()), 1e-12)
    homogeneous = np.column_stack([(points - centre) / scale, np.ones(len(points))])
    size = max(float(np.abs(pixels).max()), 1e-12)
    zero, (u, v) = np.zeros_like(homogeneous), (pixels / size).T[..., None]
    rows = np.vstack([np.hstack([homogeneous, zero, -u * homogeneous]), np.hstack([zero, homogeneous, -v * homogeneous])])
    _, singular, v_t = np.linalg.svd(rows)
    if singular[-2] < 1e-6 * singular[0]:
        raise TtError("the points lie in one plane or in another way leave the camera open")
    p = v_t[-1].reshape(3, 4)
    p[:2] *= size
    m = p[:, :3] / scale
    t = p[:, 3] - m @ centre
    length = np.linalg.norm(m[2])
    m, t = m / length, t / length
    if (points @ m[2] + t[2]).mean() < 0.0:
        m, t = -m, -t
    if focal is None:  # the rows of K R about the principal point: f is their length across the line of sight
        focal = math.sqrt(0.5 * sum(float(row @ row - (row @ m[2]) ** 2) for row in m[:2]))
    u_, _, w = np.linalg.svd(m / np.array([[focal], [focal], [1.0]]))
    rotation = u_ @ np.diag([1.0, 1.0, np.linalg.det(u_ @ w)]) @ w
    # with the rotation fixed the translation follows from the pixels
    seen = points @ rotation.T
    a = np.zeros((2 * len(points), 3))
    a[0::2, 0], a[1::2, 1], a[:, 2] = focal, focal, -pixels.ravel()
    b = (pixels * seen[:, 2:] - focal * seen[:, :2]).ravel()
    return rotation, np.linalg.lstsq(a, b, rcond=None)[0], focal
