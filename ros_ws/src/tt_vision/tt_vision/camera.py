"""The pinhole camera: projection, triangulation, and calibration from known points.

The equations are those of the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot": projection (2.3)
and (2.4), triangulation (B.72) to (B.76), calibration (B.66) to (B.71).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from tt_core.errors import BadChoice, BadShape, TtError, check_array, check_range
from tt_core.states import Array

from .projection import pixel_rays, project_points
from .resection import resection
from .triangulation import triangulate_points


class NotARotation(TtError):
    """Error: a (3, 3) matrix is not a rotation matrix."""

    def __init__(self, name: str, value: Array) -> None:
        """Keep the name of the argument and the matrix."""
        super().__init__(f"{name} is not a rotation matrix:\n{value}")
        self.name, self.value = name, value


class CannotTriangulate(TtError):
    """Error: pixels do not determine a point, because there are fewer than two cameras or the rays are parallel."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with lens distortion: pose and intrinsics.

    In the camera's frame z is the line of sight, x points to the right and y down in the image. A point p_table in the frame `table` is
    p_camera = rotation @ p_table + translation in the camera's frame (equation (2.3) of the dissertation).

    Attributes:
        rotation: (3, 3) rotation matrix from `table` to the camera's frame.
        translation: (3,) m, the origin of `table` in the camera's frame.
        focal_length: m.
        pixel_size: m, side of a square pixel.
        width: Of the image, pixels. The centre of the first pixel has the coordinates (0.0, 0.0).
        height: Of the image, pixels.
        principal_point: (2,) pixels, column and row; the middle of the image by default.
        distortion: (5,) or (4,) coefficients k1, k2, p1, p2 and optionally k3, as in OpenCV; no distortion by default.

    Raises:
        NotFinite: A number is NaN or infinite.
        OutOfRange: A length or a size is out of its range.
        BadShape: An array has the wrong shape.
        NotARotation: `rotation` is not a rotation.
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
        """Copy and check the fields, and replace those that are None by their defaults."""
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
            raise NotARotation("rotation", self.rotation)

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
        """Return a camera that sees a target in the middle of its image.

        Args:
            position: (3,) m in `table`, where the pinhole is.
            target: (3,) m in `table`, the point in the middle of the image.
            up: (3,) direction in `table` that points upwards in the image; its length does not matter.
            focal_length: m.
            pixel_size: m, side of a square pixel.
            width: Of the image, pixels.
            height: Of the image, pixels.

        Raises:
            OutOfRange: The target is at the position, or `up` is along the line of sight.
        """
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
        """Return the camera that has a given intrinsic matrix K.

        Args:
            rotation: (3, 3) rotation matrix from `table` to the camera's frame.
            translation: (3,) m, the origin of `table` in the camera's frame.
            matrix: (3, 3) intrinsic matrix K, pixels. Its two focal lengths must agree within 1 %, because the pixels are taken as square.
            width: Of the image, pixels.
            height: Of the image, pixels.
            distortion: (5,) or (4,) coefficients k1, k2, p1, p2 and optionally k3, as in OpenCV; None if there is no distortion.
            pixel_size: m, side of a pixel. It only determines which `focal_length` in m corresponds to that of K in pixels.

        Raises:
            OutOfRange: The two focal lengths differ by more than 1 %.
        """
        fx, fy = matrix[0, 0], matrix[1, 1]
        check_range("fx / fy", fx / fy if fy else math.inf, 0.99, 1.01)
        return cls(rotation, translation, 0.5 * (fx + fy) * pixel_size, pixel_size, width, height, matrix[:2, 2], distortion)

    @property
    def position(self) -> Array:
        """Position of the pinhole in `table`, (3,) m."""
        return -self.rotation.T @ self.translation

    @property
    def focal_pixels(self) -> float:
        """The focal length in pixels."""
        return self.focal_length / self.pixel_size

    @property
    def matrix(self) -> Array:
        """The intrinsic matrix K, (3, 3), pixels."""
        u, v = self.principal_point  # type: ignore[misc]
        return np.array([[self.focal_pixels, 0.0, u], [0.0, self.focal_pixels, v], [0.0, 0.0, 1.0]])

    @cached_property
    def vector(self) -> Array:
        """The camera as an array (20,) for the compiled functions; `projection.unpack_camera` gives the numbers their names.

        The order is: rotation row by row (9), translation in m (3), focal length (1) and principal point (2) in pixels, distortion (5).
        """
        head = [self.rotation.ravel(), self.translation, [self.focal_pixels]]
        return np.concatenate([*head, self.principal_point, self.distortion])

    def project(self, points: Array) -> Array:
        """Return the pixels (n, 2) at which the camera sees points (n, 3) m in `table`; NaN for a point that is not in front of it."""
        return project_points(self.vector, check_array("points", points, (-1, 3)))

    def rays(self, pixels: Array) -> Array:
        """Return the unit directions (n, 3), in the camera's frame, of the rays through pixels (n, 2), with the distortion undone."""
        return pixel_rays(self.vector, check_array("pixels", pixels, (-1, 2)))


def triangulate(cameras: Sequence[Camera], pixels: Array) -> Array:
    """Compute the positions of points from the pixels at which two or more cameras see them.

    This is the linear solution (B.74) of the dissertation. Each equation is divided by the depth of the point in that camera, so that the
    residuals are in proportion to those in the image. The depths are updated twice.

    Args:
        cameras: Two or more cameras.
        pixels: (cameras, n, 2) pixels of n points, or (cameras, 2) pixels of one point.

    Returns:
        Positions in m in `table`: (n, 3), or (3,) for one point.

    Raises:
        CannotTriangulate: There are fewer than two cameras, or the rays of a point are parallel.
        BadShape: `pixels` does not fit the number of cameras.
    """
    if len(cameras) < 2:
        raise CannotTriangulate(f"{len(cameras)} cameras cannot triangulate")
    if np.ndim(pixels) == 2:
        return triangulate(cameras, np.asarray(pixels)[:, None])[0]
    seen = check_array("pixels", pixels, (len(cameras), -1, 2))
    points = triangulate_points(np.array([camera.vector for camera in cameras]), seen)
    if not np.isfinite(points).all():
        raise CannotTriangulate("the rays of the cameras are parallel")
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
    """Calibrate a camera from points with known positions and the pixels at which the camera saw them.

    The principal point is taken to be in the middle of the image. The equations are those of the dissertation.

    Args:
        points: (n, 3) m in `table`, the known points, n >= 6, not all in one plane.
        pixels: (n, 2) pixels, where the points were seen.
        width: Of the image, pixels.
        height: Of the image, pixels.
        pixel_size: m, side of a square pixel.
        focal_length: m; None if it is to be estimated.
        distortion: Whether the distortion coefficients k1 and k2 are estimated, too; only by the method "nonlinear".
        method: "linear" solves linear equations for the pose and the focal length (Appendix B.2.4). "nonlinear" starts from that solution
            and minimises the squared distances in the image (B.71) over the pose and what else is to be estimated.

    Raises:
        CannotCalibrate: There are fewer than six points, or they lie in one plane.
        BadChoice: `method` is neither of the two.
        BadShape: `points` and `pixels` differ in length.
    """
    from scipy.optimize import least_squares  # imported here because nodes do not calibrate, and the import takes 0.06 s

    if method not in ("nonlinear", "linear"):
        raise BadChoice("method", method, ("nonlinear", "linear"))
    points, pixels = check_array("points", points, (-1, 3)), check_array("pixels", pixels, (-1, 2))
    if len(points) != len(pixels):
        raise BadShape("pixels", pixels.shape, (len(points), 2))
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    rotation, translation, focal = resection(points, pixels - middle, None if focal_length is None else focal_length / pixel_size)

    turn, shift, log_focal, radial = slice(0, 3), slice(3, 6), 6, slice(7, 9)  # elements of the unknowns (9,)

    def camera(x: Array) -> Camera:
        turned = cv2.Rodrigues(x[turn])[0] @ rotation
        focal_length_now = focal_length if focal_length is not None else math.exp(x[log_focal]) * pixel_size
        return Camera(
            turned, x[shift], focal_length_now, pixel_size, width, height, None, np.append(x[radial], [0.0, 0.0]) if distortion else None
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
