"""Measure a ball from the images of a recorded bag: position, velocity and spin."""

from pathlib import Path

import numpy as np
from tt_core.constants import RPM
from tt_core.ros.bags import Bag
from tt_core.ros.convert import ball_from_message, image_from_message, stamp_seconds
from tt_vision.measure import measure
from tt_vision.rig import high_speed_pair

BAG = Path(__file__).parents[1] / "bags" / "reference_back_5"

images: dict[str, list[np.ndarray]] = {"left": [], "right": []}
times, truth = [], []
with Bag(BAG) as bag:
    for message in bag.messages(["/camera/left/image_raw", "/camera/right/image_raw", "/sim/ball"]):
        content = bag.decode(message)
        if message.topic == "/sim/ball":
            truth.append(ball_from_message(content))
            continue
        side = message.topic.split("/")[2]
        images[side].append(image_from_message(content))
        if side == "left":
            times.append(stamp_seconds(content.header.stamp))

# frames that do not show the whole ball are left out
result = measure(np.array(images["left"]), np.array(images["right"]), np.array(times), high_speed_pair())
if result.ball is None:
    raise SystemExit(f"not measured: {result.reason}")

ball, true = result.ball, min(truth, key=lambda state: abs(state.time - result.ball.time))
print(f"frames          {len(times)} pairs")
print(f"position        {np.round(ball.position, 4)} m")
print(f"velocity        {np.round(ball.velocity, 3)} m/s")
print(f"spin            {np.round(ball.spin / RPM)} rpm")
print(f"spin error      {np.linalg.norm(ball.spin - true.spin) / RPM:.1f} rpm")
print(f"spin deviation  {np.sqrt(np.trace(ball.covariance[6:, 6:])) / RPM:.1f} rpm, as the covariance says")
