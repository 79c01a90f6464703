"""Find the joints that hold a racket state, and a swing that is there in time."""

import numpy as np
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_arm.swing import SwingLimits, plan
from tt_core.states import RacketState

arm = ArmModel.pa10()
racket = RacketState(time=0.45, position=[-0.2, 0.75, 0.3], velocity=[1.2, 0.1, 0.4], alpha=0.1, beta=1.3)
target = reach(arm, racket, arm.waiting)
if target.reason is not None:
    raise SystemExit(f"not in reach: {target.reason}")
position, rotation = arm.racket(target.q)
print(f"joint angles    {np.round(target.q, 3)} rad")
print(f"joint speeds    {np.round(target.qdot, 3)} rad/s, at most {100 * target.ratio:.0f} % of the limits")
print(f"face centre off {1e3 * np.linalg.norm(position - racket.position):.1e} mm")
print(f"velocity off    {np.linalg.norm(arm.jacobian(target.q)[:3] @ target.qdot - racket.velocity):.1e} m/s")

start = Joints(0.0, arm.waiting, np.zeros(len(arm.names)))
swing = plan(arm, start, target, racket.time, SwingLimits())
if swing.reason is not None:
    raise SystemExit(f"no swing: {swing.reason}")
q, qdot = swing.sample(racket.time)
print(f"at the strike   {np.abs(q - target.q).max():.0e} rad and {np.abs(qdot - target.qdot).max():.0e} rad/s off")
print(f"earliest strike {swing.earliest:.3f} s")
