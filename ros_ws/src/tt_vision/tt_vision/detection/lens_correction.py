"""Correction of lens distortion: the images of a burst are resampled around the ball, as a camera without distortion would see them.

A burst holds the images of one ball's passage through the high speed cameras. The compiled functions of the measurement correct only a
small distortion of OpenCV's basic model, as the narrow views of these cameras have. Any other distortion is corrected here by OpenCV, once
for each burst.
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
from .ball_detection import BACKGROUND_MARGIN

COUNTS = (4, 5, 8, 12, 14)  # numbers of coefficients of OpenCV's distortion models
SMALL_SHIFT = 1.0  # pixels, largest shift of a pixel by the model plumb_bob that the functions of the measurement correct themselves
SQUARE = 0.01  # pixels, largest error anywhere in the image if both focal lengths are replaced by their mean
INVERSE = 0.01  # pixels, largest error anywhere in the image of OpenCV's inverse of the distortion
RING_WIDTH = 0.5  # of the radius: width of the ring around a ball that is resampled with it, because its position is known only roughly
GRID = 9  # number of points along each side of the image at which a lens is checked
_PRECISE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-9)


class UndistortionFailure(Enum):
    """Why the distortion of a lens cannot be corrected."""

    CANNOT_UNDISTORT = "distortion {distortion} cannot be undone at pixel {pixel}: off by {off:.3g} pixels"


class CannotUndistort(TtError):
    """Error: a lens distortion cannot be inverted everywhere in the image."""

    def __init__(self, distortion: Array, pixel: Array, off: float) -> None:
        """Keep the values.

        Args:
            distortion: (n,) coefficients.
            pixel: (2,) pixels, where the inverse has its largest error.
            off: This error, pixels.
        """
        super().__init__(UndistortionFailure.CANNOT_UNDISTORT, distortion=distortion, pixel=pixel, off=off)
        self.distortion, self.pixel, self.off = distortion, pixel, off


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics of a camera whose lens may have any distortion that OpenCV's standard model describes.

    Attributes:
        matrix: (3, 3) intrinsic matrix K, pixels, without skew.
        distortion: (n,) coefficients in the order of OpenCV, n one of COUNTS.
        width: Of the image, pixels.
        height: Of the image, pixels.

    Raises:
        BadShape: An array has the wrong shape.
        OutOfRange: The two focal lengths differ by more than a factor of two.
        CannotUndistort: The distortion cannot be inverted everywhere in the image.
    """

    matrix: Array
    distortion: Array
    width: int
    height: int

    def __post_init__(self) -> None:
        """Copy and check the arrays, and check that the distortion can be inverted everywhere in the image."""
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
        """The mean of the two focal lengths, pixels."""
        return 0.5 * float(self.matrix[0, 0] + self.matrix[1, 1])

    def directions(self, pixels: Array) -> Array:
        """Return the rays through pixels (n, 2) as directions (n, 3) with z = 1 in the camera's frame, with the distortion undone."""
        across = cv2.undistortPoints(pixels[:, None], self.matrix, self.distortion, criteria=_PRECISE)[:, 0]
        return np.column_stack([across, np.ones(len(pixels))])

    def project(self, points: Array) -> Array:
        """Return the pixels (n, 2) at which points (n, 3) in the camera's frame are seen; their unit does not matter."""
        return np.asarray(cv2.projectPoints(points, np.zeros(3), np.zeros(3), self.matrix, self.distortion)[0][:, 0], dtype=np.float64)

    def _grid(self) -> Array:
        """Return a grid of pixels (GRID^2, 2) that covers the image."""
        u, v = np.meshgrid(np.linspace(0.0, self.width - 1.0, GRID), np.linspace(0.0, self.height - 1.0, GRID))
        return np.column_stack([u.ravel(), v.ravel()])

    @cached_property
    def is_nearly_straight(self) -> bool:
        """Whether the lens has so little distortion that images need not be resampled.

        It holds if the method `camera` is exact and the distortion shifts no pixel of the image by more than SMALL_SHIFT.
        """
        pixels, focal = self._grid(), self.matrix[[0, 1], [0, 1]]
        offsets = pixels - self.matrix[:2, 2]
        stretched = np.abs(offsets * (self.focal_pixels / focal - 1.0)).max()
        shifted = np.abs(offsets - self.directions(pixels)[:, :2] * focal).max()
        return bool(stretched <= SQUARE and shifted <= SMALL_SHIFT and not self.distortion[5:].any())

    def camera(self, pose: Camera) -> Camera:
        """Return a camera with these intrinsics at the pose of another camera.

        It is exact only if `is_nearly_straight`, because a `Camera` has one focal length and at most five distortion coefficients.

        Args:
            pose: Camera that gives the pose and the pixel size; its other intrinsics are not used.
        """
        return replace(
            pose,
            focal_length=self.focal_pixels * pose.pixel_size,
            width=self.width,
            height=self.height,
            principal_point=self.matrix[:2, 2],
            distortion=self.distortion[:5],
        )

    def resampled(self, images: np.ndarray, detections: Sequence[BallDetection], pose: Camera) -> tuple[np.ndarray, Camera]:
        """Resample images as a camera without distortion would see them, which stands at the same place and is turned towards the ball.

        Args:
            images: (k, h, w) uint8 or uint16.
            detections: Where the ball is in each image.
            pose: Camera that gives the pose and the pixel size; its other intrinsics are not used.

        Returns:
            Images (k, h', w') of the region that contains the ball in all images, and the camera that sees them.

        Raises:
            OutOfRange: The region is wider or higher than MOST_PIXELS.
        """
        square = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
        around = [(ball.u, ball.v) + ((1.0 + RING_WIDTH) * ball.radius + BACKGROUND_MARGIN) * square for ball in detections]
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
    """Correct the lens distortion of a burst: return it as images of cameras with little or no distortion.

    Images of a lens with little distortion (`Lens.is_nearly_straight`) stay as they are. Others are resampled, and their detections are
    removed, because the ball has to be found in them again.

    Args:
        burst: A burst (the images of one ball's passage) with detections, in which every image shows the whole ball.
        lenses: The lens of each camera.
        poses: For each camera a `Camera` that gives its pose and pixel size; the other intrinsics are not used.

    Raises:
        OutOfRange: The region around the ball is wider or higher than MOST_PIXELS.
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
