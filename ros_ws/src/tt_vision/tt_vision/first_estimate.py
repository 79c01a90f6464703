"""The first estimate of a ball's motion and spin, made at half the resolution while the frames of its burst arrive.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs); a frame is the images of all cameras at one
instant. As soon as a frame arrives, the outline of the ball is found in it and the ball is cut out. The effect of the light is divided out,
which leaves the marks, the printed or drawn dots on the ball. After SEARCHED frames the spin is searched with these. When the last frame
has arrived, only the motion is left to be fitted to all outlines, and the spin to be confirmed with all frames.

The first estimate is accurate enough to start a swing of the robot. `measure` refines it at the full resolution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from tt_core.arrays import Array, Image
from tt_core.constants import BALL_RADIUS
from tt_core.failures import Failure

from .camera import Camera
from .capture.burst import BallDetection, Burst
from .detection.ball_detection import fit_outline
from .detection.illumination import GLOSS, CalibratedLamps, Illumination, fit_illumination, image_gain, lamp_illumination
from .detection.outline import BLUR, edge_blur
from .motion_fit import VAGUE_OUTLINE, BallMotion, fit_motion, fit_motion_to_outlines
from .projection import ray, unpack_camera
from .spin.coarse_search import DENSE_TURN
from .spin.estimate import SpinReason
from .spin.registration import DEFAULT_SEARCH, Proposal, Registration, SearchParams, propose, register
from .spin.soft_surface import SoftSurface, cut_out_halved, halved_views, soft_surface
from .spin.surface_map import BORDER, VIEW, divide_light, motion_views, pixel_normals, view_middles

SEARCHED = 3  # number of frames with which the spin is searched before the burst is complete; the result is confirmed with all frames
GROWTH = 1.1  # factor by which the ball may grow in the image from the first frame on before all frames are cut out again
MOST_CIRCLE_SHIFT = 1.0  # pixels between the circle in one image and the fitted motion above which the ball is cut out again
LEAST_CONTRAST = (
    0.004  # variance of the brightness (white is 1) below which the ball has no marks: without marks it reaches 0.0005, with 2 % 0.006
)


@dataclass(frozen=True, eq=False)
class FirstEstimate:
    """The first estimate of a ball's motion and spin from a burst (the images of its passage), made at half the resolution.

    Attributes:
        motion: Position and velocity; None if no motion was found.
        found: The spin and how well the marks (dots on the ball) agree with it; None if it was not searched. Check its `is_believed`.
        light: The light on the ball; None if no motion was found.
        surface: The surface of the ball in all frames at half the resolution; None if no motion was found.
        reason: Why the spin was not searched; None if it was.
    """

    motion: BallMotion | None
    found: Registration | None
    light: Illumination | None
    surface: SoftSurface | None
    reason: Failure | None


@dataclass(eq=False)
class _Frame:
    """One frame: the images of all cameras at one instant, and what is computed from them; (n, n) is the ball at half the resolution.

    Attributes:
        time: s.
        images: For each camera the whole image (h, w).
        detections: Where the ball is in each image.
        points: For each camera the outline points (n,) OUTLINE_POINT, at the full resolution.
        circles: (cameras, 3) column u, row v and radius of the ball, pixels of the full resolution.
        views: (cameras,) VIEW of the cut-out images, except while they have not been cut out.
        stack: (cameras, n, n) float32, cut-out images, grey levels over the background.
        normals: (cameras, n, n) NORMAL, the ball's normal in each pixel.
        gains: (cameras,) factor on the light in each image.
        brightness: (cameras, n, n) float32, surface of the ball without the effect of light, white is 1; empty before the light is known.
        weights: (cameras, n, n) float32, weight of each pixel; empty before the light is known.
    """

    time: float
    images: Sequence[Image]
    detections: Sequence[BallDetection]
    points: list[np.ndarray]
    circles: Array
    views: np.ndarray
    stack: np.ndarray = field(default_factory=lambda: np.empty(0))
    normals: np.ndarray = field(default_factory=lambda: np.empty(0))
    gains: Array = field(default_factory=lambda: np.empty(0))
    brightness: np.ndarray = field(default_factory=lambda: np.empty(0))
    weights: np.ndarray = field(default_factory=lambda: np.empty(0))


class FirstEstimator:
    """Takes the frames of one burst (the images of one ball's passage) as they arrive, and makes the first estimate of motion and spin."""

    def __init__(
        self,
        cameras: Sequence[Camera],
        search: SearchParams = DEFAULT_SEARCH,
        lamps: CalibratedLamps | None = None,
        executor: Executor | None = None,
    ) -> None:
        """Create it without any frame.

        Args:
            cameras: The cameras that take the images.
            search: Parameters of the search for the spin.
            lamps: Calibrated lamps; None if the light is to be fitted to the images.
            executor: Runs the search for the spin while further frames are added; None if it is to run within `add`.
        """
        self._cameras, self._search, self._lamps = tuple(cameras), search, lamps
        self._vectors = np.array([camera.vector for camera in cameras])
        self._views = _still_views(self._cameras)
        self._blurs = np.full(len(self._cameras), BLUR)  # pixels, blur of each camera's images, estimated when the first frame is added
        self._frames: list[_Frame] = []
        self._size = 0  # pixels of the full resolution, side of the square that is cut out
        self._light: Illumination | None = None  # fitted to the frames with which the spin is searched
        self._top = 0.0  # grey level of the brightest pixel of these frames, over the background
        self._executor = executor
        self._proposal: Future[Proposal] | None = None

    @property
    def times(self) -> list[float]:
        """The times of the frames that have been added, s."""
        return [frame.time for frame in self._frames]

    def add(self, time: float, images: Sequence[Image], detections: Sequence[BallDetection]) -> None:
        """Add one frame: the images of all cameras at one instant. All of them must show the whole ball.

        Args:
            time: s, later than that of the frame before.
            images: For each camera one image (h, w), uint8 or uint16.
            detections: Where the ball is in each image.
        """
        circles, points = np.array([(ball.u, ball.v, ball.radius) for ball in detections]), list[np.ndarray]()
        for c, (image, ball) in enumerate(zip(images, detections, strict=True)):
            found = fit_outline(image, circles[c], ball.contrast, True, self._blurs[c])
            if not self._frames and (blur := edge_blur(image, found)) > BLUR:
                self._blurs[c] = blur
                found = fit_outline(image, circles[c], ball.contrast, True, blur)
            found["camera"], found["frame"] = c, len(self._frames)
            points.append(found)
        frame = _Frame(time, images, detections, points, circles, self._circle_views(circles))
        self._frames.append(frame)
        if not self._fits(frame):
            for other in self._frames:
                self._cut_out(other, self._circle_views(other.circles))
        else:
            self._cut_out(frame, frame.views)
        if self._light is not None:
            self._divide(frame)
        elif len(self._frames) == SEARCHED:
            self._light_up()
            if self._search.max_spin * (self._frames[1].time - self._frames[0].time) <= DENSE_TURN:
                surface = self._surface()
                self._proposal = self._propose(surface) if surface.contrast >= LEAST_CONTRAST else None

    def estimate(self, burst: Burst) -> FirstEstimate:
        """Compute the first estimate, once all frames of a burst have been added.

        Args:
            burst: The burst of exactly these frames, with cameras and detections.
        """
        points = np.concatenate([frame.points[c] for c in range(len(self._cameras)) for frame in self._frames])
        circles = np.array([frame.circles for frame in self._frames]).swapaxes(0, 1)
        motion = fit_motion_to_outlines(burst, points, circles, self._blurs)
        if isinstance(motion, Failure) or motion.sharp_residual > VAGUE_OUTLINE:
            motion = fit_motion(burst)
        if isinstance(motion, Failure):
            return FirstEstimate(None, None, None, None, motion)
        views = motion_views(motion, burst)
        if np.abs(view_middles(views) - circles[..., :2].reshape(-1, 2)).max() > MOST_CIRCLE_SHIFT:
            self._cut_out_again(views)
        elif self._light is None:
            self._light_up()
        surface = self._surface().seen_from(views)
        light = self._whole_light()
        if surface.contrast < LEAST_CONTRAST:
            return FirstEstimate(motion, None, light, surface, Failure(SpinReason.NO_MARKS))
        proposal = None if self._proposal is None else self._proposal.result()
        return FirstEstimate(motion, register(surface, self._search, proposal), light, surface, None)

    def _propose(self, surface: SoftSurface) -> Future[Proposal]:
        """Search the spin with the frames so far, in the executor if there is one."""
        if self._executor is not None:
            return self._executor.submit(propose, surface, self._search)
        done = Future[Proposal]()
        done.set_result(propose(surface, self._search))
        return done

    def _fits(self, frame: _Frame) -> bool:
        """Return whether the ball of a frame fits into the square that is cut out; if not, enlarge the square.

        For the first frame the square is only determined, and the result is True.
        """
        reach = float(frame.circles[:, 2].max())
        if 2.0 * (reach + BORDER) <= self._size:
            return True
        first = self._size == 0
        self._size = 4 * math.ceil((GROWTH * reach + BORDER) / 2.0)
        return first

    def _circle_views(self, circles: Array) -> np.ndarray:
        """Return (cameras,) VIEW of the whole images, for a ball that each camera sees as the circle in `circles` (cameras, 3)."""
        views, centres = self._views.copy(), _circle_centres(self._vectors, circles)
        views["centre"] = centres
        towards = np.einsum("cj,cjk->ck", centres, views["rotation"])
        views["towards_camera"] = -towards / np.sqrt((towards * towards).sum(axis=1, keepdims=True))
        return views

    def _cut_out(self, frame: _Frame, views: np.ndarray) -> None:
        """Cut the ball out of the images of a frame, at half the resolution. views: (cameras,) VIEW of the whole images."""
        half = self._size // 2
        corners = np.rint(view_middles(views)).astype(np.int64) - half
        views = views.copy()
        views["principal_point"] -= corners
        frame.views, frame.stack = halved_views(views), np.empty((len(views), half, half), dtype=np.float32)
        for image, ball, (u, v), out in zip(frame.images, frame.detections, corners.tolist(), frame.stack, strict=True):
            cut_out_halved(image, u, v, ball.background, out)
        frame.normals = pixel_normals(half, frame.views)
        if self._light is not None and len(frame.brightness):
            self._divide(frame)

    def _cut_out_again(self, views: np.ndarray) -> None:
        """Cut the ball out of all frames again, where the fitted motion puts it, and discard the light and the search so far.

        Args:
            views: (images,) VIEW of the whole images.
        """
        self._light = self._proposal = None
        for k, frame in enumerate(self._frames):
            self._cut_out(frame, np.ascontiguousarray(views[k :: len(self._frames)]))
        self._light_up()

    def _light_up(self) -> None:
        """Fit the light to the frames so far, and divide their images by it."""
        stack, normals = self._by_camera("stack"), self._by_camera("normals")
        if self._lamps is None:
            self._light = fit_illumination(stack, normals, len(self._cameras))
        else:
            self._light = lamp_illumination(stack, normals, self._by_camera("views")["centre"], self._cameras, self._lamps)
        self._top = float(stack.max())
        for frame, gains in zip(self._frames, self._light.gains.reshape(len(self._cameras), -1).T, strict=True):
            frame.gains = gains
            frame.brightness, frame.weights = divide_light(
                frame.stack, frame.normals, frame.views, self._light._replace(gains=gains), self._top
            )

    def _divide(self, frame: _Frame) -> None:
        """Divide the images of one more frame by the light that is known, after estimating their gains."""
        light: Illumination = self._light  # type: ignore[assignment]
        if self._lamps is not None:
            frame.gains = lamp_illumination(frame.stack, frame.normals, frame.views["centre"], self._cameras, self._lamps).gains
        else:
            last = light.gains.reshape(len(self._cameras), -1)[:, -1]
            frame.gains = np.array([image_gain(*each) for each in zip(frame.stack, frame.normals, light.harmonics, last, strict=True)])
        frame.brightness, frame.weights = divide_light(
            frame.stack, frame.normals, frame.views, light._replace(gains=frame.gains), self._top
        )

    def _surface(self) -> SoftSurface:
        """Return the surface of the ball in all frames so far."""
        times = np.array(self.times)
        brightness, weights, views = (self._by_camera(name) for name in ("brightness", "weights", "views"))
        return soft_surface(brightness, weights, views, times - times.mean())

    def _whole_light(self) -> Illumination:
        """Return the light with the gains of the images of all frames."""
        light: Illumination = self._light  # type: ignore[assignment]
        return light._replace(gains=self._by_camera("gains"), gloss=np.zeros((len(self._cameras), GLOSS)))

    def _by_camera(self, name: str) -> np.ndarray:
        """Return the attribute `name` of all frames as one array (images, ...), with all images of the first camera first."""
        first = getattr(self._frames[0], name)
        out = np.empty((len(first), len(self._frames), *first.shape[1:]), dtype=first.dtype)
        for k, frame in enumerate(self._frames):
            out[:, k] = getattr(frame, name)
        return out.reshape(-1, *first.shape[1:])


def estimator_of(
    burst: Burst, search: SearchParams = DEFAULT_SEARCH, lamps: CalibratedLamps | None = None, executor: Executor | None = None
) -> FirstEstimator:
    """Create a `FirstEstimator` and add all frames of a complete burst to it.

    Args:
        burst: A burst (the images of one ball's passage) with cameras and detections; every image shows the whole ball.
        search: Parameters of the search for the spin.
        lamps: Calibrated lamps; None if the light is to be fitted to the images.
        executor: Runs the search for the spin while further frames are added; None if it is to run in between.
    """
    estimator = FirstEstimator(burst.cameras, search, lamps, executor)
    for k, time in enumerate(burst.times.tolist()):
        estimator.add(time, [stack[k] for stack in burst.images], [row[k] for row in burst.detections])
    return estimator


def _still_views(cameras: Sequence[Camera]) -> np.ndarray:
    """Return (cameras,) VIEW with the fields that are the same in all frames: rotation and intrinsics of each camera."""
    views = np.zeros(len(cameras), dtype=VIEW)
    for c, camera in enumerate(cameras):
        views["rotation"][c], views["focal"][c] = camera.rotation, camera.focal_pixels
        views["principal_point"][c], views["distortion"][c] = camera.principal_point, camera.distortion
    return views


@njit(cache=True, nogil=True)
def _circle_centres(vectors: Array, circles: Array) -> Array:
    """Compute for each camera the centre of a ball that it sees as a given circle: (cameras, 3) m in the camera's own frame.

    Args:
        vectors: (cameras, 20) `Camera.vector` of each camera.
        circles: (cameras, 3) column u and row v of the centre, and radius, pixels.
    """
    centres = np.empty((len(circles), 3))
    for c in range(len(circles)):
        optics = unpack_camera(vectors[c]).optics
        x, y = ray(optics, circles[c, 0], circles[c, 1])
        z = optics.focal * BALL_RADIUS / circles[c, 2]
        centres[c, 0], centres[c, 1], centres[c, 2] = x * z, y * z, z
    return centres
