"""The arm node with a fault in its logic, which shows a little after the arm has begun to move."""

from tt_arm.arm_node import ArmNode
from tt_core.ros.node_main import run


class CrashingArm(ArmNode):
    """Raises in every joint state after the thirtieth that asks for motion."""

    def __init__(self) -> None:
        super().__init__()
        self.moved, self.healthy = 0, self.control.step
        self.control.step = self.crash

    def crash(self, joints, now, clock, *, has_speeds):
        step = self.healthy(joints, now, clock, has_speeds=has_speeds)
        self.moved += bool(step.command.any())
        if self.moved > 30:
            raise RuntimeError("a crash")
        return step


def main() -> None:
    run(CrashingArm)
