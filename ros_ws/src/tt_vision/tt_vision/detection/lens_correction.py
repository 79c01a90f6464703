"""Correction of lens distortion: a burst is resampled, around the ball, as a camera without distortion would see it.

The kernels of the measurement undo little distortion, which the narrow views of the high speed cameras have. Every model of OpenCV is
undone here by OpenCV, once for each burst.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.errors import BadShape, TtError, check_array, check_range
from tt_core.images import MOST_PIXELS
from tt_core.states import Array

from ..camera import Camera
from ..capture.burst import BallDetection, Burst
from .ball_detection import MARGIN

COUNTS = (4, 5, 8, 12, 14)  # coefficients of OpenCV's models
LITTLE = 1.0  # pixels, a shift that the kernels of the measurement undo themselves when it has the form of plumb_bob
SQUARE = 0.01  # pixels, by which the mean of the two focal lengths may miss a pixel of the image
INVERSE = 0.01  # pixels, by which OpenCV's inverse may miss a pixel of the image
ROOM = 0.5  # radii around a ball that are resampled with it: where it is is known roughly only
GRID = 9  # points along each side of the image at which a lens is checked
_PRECISE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-9)


class LensReason(Enum):
    """Why a lens is refused."""

    CANNOT_UNDISTORT = "distortion {distortion} cannot be undone at pixel {pixel}: off by {off:.3g} pixels"


class CannotUndistort(TtError):
    """A distortion that cannot be undone everywhere in the image."""

    def __init__(self, distortion: Array, pixel: Array, off: float) -> None:
        """Keep the distortion, the worst pixel, and by how many pixels it is missed."""
        super().__init__(LensReason.CANNOT_UNDISTORT, distortion=distortion, pixel=pixel, off=off)
        self.distortion, self.pixel, self.off = distortion, pixel, off


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics of a camera with any distortion of OpenCV's standard model.

    Attributes:
        matrix: (3, 3) K in pixels, without skew.
        distortion: (n,) in the order of OpenCV, n one of COUNTS.
        width: Pixels.
        height: Pixels.

    Raises:
        BadShape: An array has the wrong shape.
        OutOfRange: The focal lengths differ by more than a factor of two.
        CannotUndistort: The distortion cannot be undone everywhere in the image.
    """

    matrix: Array
    distortion: Array
    width: int
    height: int

    def __post_init__(self) -> None:
        """Copy the arrays and refuse what cannot be undone."""
        object.__setattr__(self, "matrix", check_array("matrix", self.matrix, (3, 3)))
        object.__setattr__(self, "distortion", check_array("distortion", self.distortion, (-1,)))
        if len(self.distortion) not in COUNTS:
            raise BadShape("distortion", self.distortion.shape, f"(n,) with n one of {COUNTS}")
        check_range("fx / fy", self.matrix[0, 0] / self.matrix[1, 1], 0.5, 2.0)
        pixels = self._grid()
        off = np.linalg.norm(self.project(self.directions(pixels)) - pixels, axis=1)
        if not (off < INVERSE).all():
            worst = np.argmax(np.nan_to_num(off, nan=np.inf))
            raise CannotUndistort(self.distortion, pixels[worst], float(off[worst]))

    @property
    def focal_pixels(self) -> float:
        """The mean of both focal lengths, pixels."""
        return 0.5 * float(self.matrix[0, 0] + self.matrix[1, 1])

    def directions(self, pixels: Array) -> Array:
        """Return the directions (n, 3), with z = 1, of pixels (n, 2) in the camera's frame."""
        across = cv2.undistortPoints(pixels[:, None], self.matrix, self.distortion, criteria=_PRECISE)[:, 0]
        return np.column_stack([across, np.ones(len(pixels))])

    def project(self, points: Array) -> Array:
        """Return the pixels (n, 2) of points (n, 3) in the camera's frame."""
        return np.asarray(cv2.projectPoints(points, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0][:, 0], dtype=np.float64)

    def _grid(self) -> Array:
        """Return pixels (GRID^2, 2) spread over the image."""
        u, v = np.meshgrid(np.linspace(0.0, self.width - 1.0, GRID), np.linspace(0.0, self.height - 1.0, GRID))
        return np.column_stack([u.ravel(), v.ravel()])

    @cached_property
    def is_nearly_straight(self) -> bool:
        """Whether `camera` is exact and its distortion shifts no pixel by more than LITTLE."""
        pixels, focal = self._grid(), self.matrix[[0, 1], [0, 1]]
        offsets = pixels - self.matrix[:2, 2]
        stretched = np.abs(offsets * (self.focal_pixels / focal - 1.0)).max()
        shifted = np.abs(offsets - self.directions(pixels)[:, :2] * focal).max()
        return bool(stretched <= SQUARE and shifted <= LITTLE and not self.distortion[5:].any())

    def camera(self, pose: Camera) -> Camera:
        """Return these intrinsics at the pose of another camera. Exact where the lens is nearly straight."""
        return replace(
            pose,
            focal_length=self.focal_pixels * pose.pixel_size,
            width=self.width,
            height=self.height,
            principal_point=self.matrix[:2, 2],
            distortion=self.distortion[:5],
        )

    def resampled(self, images: np.ndarray, detections: Sequence[BallDetection], pose: Camera) -> tuple[np.ndarray, Camera]:
        """Return the images as a camera without distortion would see them that stands in the same place and is turned towards the ball.

        Args:
            images: (k, h, w) uint8 or uint16.
            detections: Where the ball is in each of them.
            pose: The camera's pose; its intrinsics do not count.

        Returns:
            Images (k, h', w') of the region around the ball, and their camera.

        Raises:
            OutOfRange: The region is larger than MOST_PIXELS.
        """
        square = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
        around = [(ball.u, ball.v) + ((1.0 + ROOM) * ball.radius + MARGIN) * square for ball in detections]
        rays = self.directions(np.clip(np.concatenate(around), 0.0, (self.width - 1.0, self.height - 1.0)))
        towards = rays.mean(axis=0)
        turn = Rotation.align_vectors([[0.0, 0.0, 1.0]], [towards])[0].as_matrix()
        seen = rays @ turn.T
        pixels = self.focal_pixels * seen[:, :2] / seen[:, 2:]
        corner = np.floor(pixels.min(axis=0))
        width, height = (
            int(check_range("region of the ball, pixels,", size, 1, MOST_PIXELS)) for size in np.ceil(np.ptp(pixels, axis=0)) + 2
        )
        matrix = np.array([[self.focal_pixels, 0.0, -corner[0]], [0.0, self.focal_pixels, -corner[1]], [0.0, 0.0, 1.0]])
        maps = cv2.initUndistortRectifyMap(self.matrix, self.distortion, turn, matrix, (width, height), cv2.CV_32FC1)
        resampled = np.array([cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for image in images])
        camera = Lens(matrix, np.zeros(5), width, height).camera(pose)
        return resampled, replace(camera, rotation=turn @ pose.rotation, translation=turn @ pose.translation)


def straighten(burst: Burst, lenses: Sequence[Lens], poses: Sequence[Camera]) -> Burst:
    """Return a burst that is taken by cameras with little distortion.

    Images through a nearly straight lens stay as they are. Others are resampled, and the ball has to be looked for in them again.

    Args:
        burst: A burst with detections, of which every image shows the whole ball.
        lenses: The lens of each camera.
        poses: The pose of each camera; its intrinsics do not count.

    Raises:
        OutOfRange: The region around the ball is larger than MOST_PIXELS.
    """
    images, cameras, detections = list[np.ndarray](), list[Camera](), list[tuple[BallDetection, ...]]()
    for stack, found, lens, pose in zip(burst.images, burst.detections, lenses, poses, strict=True):
        if lens.is_nearly_straight:
            camera = lens.camera(pose)
        else:
            (stack, camera), found = lens.resampled(stack, found, pose), ()
        images.append(stack)
        cameras.append(camera)
        detections.append(found)
    return replace(burst, images=tuple(images), cameras=tuple(cameras), detections=tuple(detections))
