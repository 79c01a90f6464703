"""Make the images of a report: those from which a ball was measured, with its outline and its spin drawn into them as SVG."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.arrays import Array, Image
from tt_core.constants import BALL_RADIUS, RPM
from tt_core.errors import TtError
from tt_core.ros.bags import Bag
from tt_vision.camera import Camera
from tt_vision.capture.burst import Burst
from tt_vision.detection.outline import scan_outline
from tt_vision.measure import Measurement
from tt_vision.rig import SIDES

from ..stages import Values, Vision

MOST_SHOWN_FRAMES = 6  # at most so many images of each camera are shown, the last ones
SHOWN_RADII = 1.35  # radii of the ball from its centre to the edge of a shown image
SIZE = 150  # pixels, width and height of a shown image
CIRCLE_POINTS = 60  # points of a drawn circle
REACH = 4.0  # pixels, distance from the outline within which edges are looked for, as in the measurement
QUALITY = 85  # quality of the JPEG images


@dataclass(frozen=True)
class ShownImage:
    """The part of a camera image around the ball, with the measured ball as SVG paths in the pixels of this part.

    Attributes:
        camera: Name of the camera.
        time: Middle of the exposure, s.
        jpeg: The part, SIZE x SIZE pixels, as JPEG in base64.
        outline: SVG path of the outline of the measured ball; "" if it was not measured.
        edges: SVG path of dots at which the edge of the ball was found in the image; "" if the ball was not measured.
        equator: SVG path of the visible parts of two circles on the ball: the equator of the spin, and a meridian that turns with the ball.
        off: Median distance of the edges from the outline, pixels of the camera; None without both.
    """

    camera: str
    time: float
    jpeg: str
    outline: str
    edges: str
    equator: str
    off: float | None


@dataclass(frozen=True)
class BallImages:
    """The images of one burst, with the result of measuring them anew.

    A burst is the images of one ball's passage through the high-speed cameras.

    Attributes:
        time: Time of the last image, s.
        images: The images, sorted by camera, then by time.
        words: Text about the result of the measurement, for people.
    """

    time: float
    images: Sequence[ShownImage]
    words: str


def read_ball_images(path: Path, values: Values) -> Iterator[BallImages]:
    """Measure the bursts of a recording anew, as estimate_node does.

    Args:
        path: The recording, a bag of any kind.
        values: Parameter values of estimate_node by name.

    Yields:
        The images and the result of each burst, in the order of time.

    Raises:
        BagError: The bag cannot be read, or holds several robots.
    """
    vision = Vision(values)
    with Bag(path) as bag:
        names = {full: name for name in sorted(vision.inputs) if (full := bag.find(name))}
        for message in bag.messages(list(names)) if names else ():
            try:
                burst = vision.add(names[message.topic], bag.decode(message))
                measured = None if burst is None else vision.measure(burst)
            except TtError:  # an image or a calibration that the node refuses, too
                continue
            if measured is not None:
                yield ball_images(*measured, [SIDES[side] for side in vision.sides])


def ball_images(burst: Burst, result: Measurement, names: Sequence[str]) -> BallImages:
    """Return the images of a burst with the measured ball drawn into them.

    Args:
        burst: The burst, with its cameras.
        result: The measurement of the burst.
        names: Name of each camera of the burst.
    """
    times = burst.times[-MOST_SHOWN_FRAMES:]
    first = len(burst) - len(times)
    motion, spin = result.motion, result.spin.spin if result.spin is not None and result.ball is not None else None
    places = motion.positions(burst.times) if motion is not None else None
    images = []
    for c, (camera, stack) in enumerate(zip(burst.cameras, burst.images, strict=True)):
        for k in range(first, len(burst)):
            found = burst.detections[c][k] if burst.detections and burst.detections[c] else None
            ball = None
            if motion is not None and places is not None:
                since = float(burst.times[k] - burst.times[-1])
                ball = _Ball(places[k], camera, motion.offsets[c], float(motion.edges[c]), spin, since)
            contrast = found.contrast if found is not None else float(np.ptp(stack[k]))
            images.append(_shown(names[c], float(burst.times[k]), stack[k], ball, contrast))
    return BallImages(float(burst.times[-1]), images, _words(result))


@dataclass(frozen=True, eq=False)
class _Ball:
    """The measured ball at the time of one image, as the camera sees it.

    Attributes:
        place: (3,) m, its centre in the frame `table`.
        camera: The camera.
        offset: (2,) pixels, from where the calibrated camera would see the ball to where it sees the ball.
        edge: Distance by which this camera finds the outline too far out, pixels.
        spin: (3,) rad/s; None if it was not measured.
        since: Time of the image minus the time of the last image, s, not positive.
    """

    place: Array
    camera: Camera
    offset: Array
    edge: float
    spin: Array | None
    since: float

    def limb(self) -> Array:
        """Return the outline of the measured ball in this image, points (n, 2) pixels."""
        line = self.place - self.camera.position
        distance = float(np.linalg.norm(line))
        towards = line / distance
        across, up = _across(towards)
        middle = self.place - BALL_RADIUS**2 / distance * towards
        radius = BALL_RADIUS * np.sqrt(1.0 - (BALL_RADIUS / distance) ** 2)
        points = self.camera.project(middle + radius * _circle(across, up)) + self.offset
        outwards = points - points.mean(axis=0)
        return points + self.edge * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)

    def turning_lines(self) -> list[Array]:
        """Return the visible parts of the spin's equator and of a meridian that turns with the ball, as lines of points (n, 2) pixels.

        The list is empty if the spin was not measured or is below 1 rad/s.
        """
        speed = 0.0 if self.spin is None else float(np.linalg.norm(self.spin))
        if self.spin is None or speed < 1.0:
            return []
        axis = self.spin / speed
        across, up = _across(axis)
        turned = Rotation.from_rotvec(self.spin * self.since).apply(np.array([across]))[0]
        lines = []
        for circle in (_circle(across, up), _circle(axis, turned)):
            points = self.place + BALL_RADIUS * circle
            seen = ((self.camera.position - points) * circle).sum(axis=1) > 0.0
            pixels = self.camera.project(points) + self.offset
            cuts = np.flatnonzero(np.diff(seen.astype(int))) + 1
            lines += [part for part, is_seen in zip(np.split(pixels, cuts), np.split(seen, cuts), strict=True) if is_seen[0]]
        return lines


def _across(axis: Array) -> tuple[Array, Array]:
    """Return two directions that are perpendicular to a direction and to each other, (3,) each."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, other)
    across /= np.linalg.norm(across)
    return across, np.cross(axis, across)


def _circle(one: Array, other: Array) -> Array:
    """Return the points (n, 3) of the unit circle through two perpendicular directions."""
    angles = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS + 1)[:, None]
    return np.cos(angles) * one + np.sin(angles) * other


def _shown(name: str, time: float, image: Image, ball: _Ball | None, contrast: float) -> ShownImage:
    height, width = image.shape
    limb, points, off = ball.limb() if ball is not None else None, np.empty((0, 2)), None
    if limb is not None and np.isfinite(limb).all():
        middle = limb.mean(axis=0)
        radius = float(np.linalg.norm(limb - middle, axis=1).mean())
        edges = scan_outline(image, middle[0], middle[1], max(1.0, radius - REACH), radius + REACH, contrast)
        points, off = np.column_stack([edges["u"], edges["v"]]), _distance(edges, limb)
    else:
        limb, middle, radius = None, np.array([width - 1, height - 1]) / 2, min(width, height) / 2 / SHOWN_RADII
    half = SHOWN_RADII * radius
    corner, scale = middle - half, SIZE / (2.0 * half)
    matrix = np.array([[scale, 0.0, -scale * corner[0]], [0.0, scale, -scale * corner[1]]])
    full = 255.0 / max(float(image.max()), 1.0)
    part = cv2.warpAffine((image * full).astype(np.uint8), matrix, (SIZE, SIZE), flags=cv2.INTER_LINEAR)
    jpeg = base64.b64encode(cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()).decode()
    lines = ball.turning_lines() if ball is not None and limb is not None else []
    to_svg = lambda rows: scale * (np.asarray(rows) - corner)  # noqa: E731
    return ShownImage(
        name,
        time,
        jpeg,
        _svg_path(to_svg(limb)) if limb is not None else "",
        "".join(f"M{u:.1f} {v:.1f}h0" for u, v in to_svg(points)) if len(points) else "",
        "".join(_svg_path(to_svg(line)) for line in lines if len(line) > 1),
        off,
    )


def _distance(edges: np.ndarray, limb: Array) -> float | None:
    """Return the median distance of edges from an outline (n, 2), pixels; None without edges.

    It is the median, because the marks (dots on the ball) make some edges lie far from the outline.
    """
    if not len(edges):
        return None
    middle = limb.mean(axis=0)
    rays, arms = np.column_stack([edges["u"], edges["v"]]) - middle, limb[:-1] - middle
    order = np.argsort(np.arctan2(arms[:, 1], arms[:, 0]))
    angles, radii = np.arctan2(arms[order, 1], arms[order, 0]), np.linalg.norm(arms[order], axis=1)
    expected = np.interp(np.arctan2(rays[:, 1], rays[:, 0]), angles, radii, period=2.0 * np.pi)
    return float(np.median(np.abs(np.linalg.norm(rays, axis=1) - expected)))


def _svg_path(points: Array) -> str:
    return "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in points)


def _words(result: Measurement) -> str:
    """Return a text about what was measured from the images, or why nothing was."""
    if result.ball is None or result.motion is None or result.spin is None:
        return f"Not measured: {result.reason}."
    rpm = np.linalg.norm(result.ball.spin) / RPM
    return (
        f"Measured from {result.used} pairs of images: {np.linalg.norm(result.ball.velocity):.2f} m/s, {rpm:.0f} rpm. "
        f"The outlines fit within {result.motion.residual:.2f} pixels (rms). "
        f"The marks agree up to a residual of {result.spin.residual:.3f}, where 0 is full agreement and 1 is none."
    )
