"""Find drag, lift and restitution from positions of flights, as a lab would record them."""

import numpy as np
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.identify import coefficient, identify
from tt_predict.recordings import Flight
from tt_predict.rollout import StopRule, rollout

truth, rng, flights = Physics.measured(), np.random.default_rng(0), []
for _ in range(12):
    spin = np.array([0.0, rng.uniform(-350.0, 350.0), rng.uniform(-50.0, 50.0)])
    velocity = np.array([rng.uniform(-7.0, -5.0), rng.uniform(-0.3, 0.3), rng.uniform(0.5, 2.0)])
    path = rollout(BallState(0.0, [2.6, 0.76, 0.34], velocity, spin), truth, StopRule.at_x(0.0))
    times = np.arange(0.0, path.times[-1], 1.0 / 180.0)  # cameras at 180 Hz
    seen = path.rows(times)[:, :3] + rng.normal(0.0, 2e-3, (len(times), 3))  # 2 mm of noise
    flights.append(Flight("launcher", times, seen, spin))

names = ("air.drag", "air.lift_ratio", "table.restitution", "table.friction")
found = identify(flights, Physics.measured(), names)
print("coefficient        found            true")
for name, value, interval in zip(found.names, found.values, found.intervals, strict=True):
    print(f"{name:18} {value:.3f} +- {interval:.3f}  {coefficient(truth, name):.3f}")
print(f"rms of all points  {1e3 * found.rms[1]:.2f} mm")
