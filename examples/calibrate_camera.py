"""Calibrate a camera from known points of the table, and see a ball with it."""

import numpy as np
from tt_core.constants import NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_vision.camera import calibrate, triangulate
from tt_vision.rig import wide_pair

# corners of the table, of the net's tape, and points on the lines, as somebody clicked them in the images
points = np.array(
    [[x, y, 0.0] for x in (0.0, 0.685, 1.37, 2.055, TABLE_LENGTH) for y in (0.0, TABLE_WIDTH / 2, TABLE_WIDTH)]
    + [[NET_X, y, NET_HEIGHT] for y in (0.0, TABLE_WIDTH / 2, TABLE_WIDTH)]
)
rng = np.random.default_rng(0)
true = wide_pair()
cameras = []
for camera in true:
    clicked = camera.project(points) + rng.normal(0.0, 0.3, (len(points), 2))  # pixels
    found = calibrate(points, clicked, width=camera.width, height=camera.height, pixel_size=camera.pixel_size)
    residual = np.sqrt(np.mean((found.project(points) - clicked) ** 2))
    off = 1e3 * np.linalg.norm(found.position - camera.position)
    print(f"focal length {1e3 * found.focal_length:.2f} mm, residual {residual:.2f} pixels, camera {off:.0f} mm off")
    cameras.append(found)

ball = np.array([[0.5, 0.7, 0.3]])
pixels = np.array([camera.project(ball) for camera in true])
print(f"ball at {np.round(triangulate(cameras, pixels)[0], 3)} m, truly at {ball[0]} m")
