"""Predict a ball, solve for the racket that returns it with the spin asked for, and check it by simulation."""

import numpy as np
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_predict.rollout import StopRule, rollout
from tt_racket.stroke import solve

physics = Physics.liu()
ball = BallState(0.0, position=[2.6, 0.76, 0.34], velocity=[-6.2, 0.1, 1.0], spin=[0.0, -360.0, 30.0])
path = rollout(ball, physics, StopRule.at_x(-0.15))
print(f"bounce at       {np.round(path.bounces[0].position[:2], 3)} m after {path.bounces[0].time:.3f} s")
print(f"hit at          {np.round(path.end.position, 3)} m after {path.end.time:.3f} s")

goal = ReturnGoal(landing=[2.1, 0.6], flight_time=0.6, spin_y=100.0, spin_z=0.0)
stroke = solve(path.end, goal, physics)
if stroke.racket is None:
    raise SystemExit(f"no stroke: {stroke.reason}")
racket = stroke.racket
print(f"racket velocity {np.round(racket.velocity, 3)} m/s")
print(f"racket normal   {np.round(racket.normal, 3)}")

velocity, spin = physics.racket.after(path.end.velocity, path.end.spin, racket)
end = fly(np.concatenate([path.end.position, velocity, spin]), goal.flight_time, physics.air.coefficients)
print(f"lands at        {np.round(end[:2], 4)} m, asked {np.round(goal.landing, 4)} m")
print(f"spin y, z       {np.round(spin[1:], 1)} rad/s, asked [{goal.spin_y:.1f} {goal.spin_z:.1f}]")
