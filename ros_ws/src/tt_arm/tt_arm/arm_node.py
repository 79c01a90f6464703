"""Drives the arm: strokes in, joint velocity commands out, one for each joint state."""

from __future__ import annotations

import re
import time

from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.ros.convert import joints_from_message, seconds, strokes_from_message, swing_to_message
from tt_core.ros.params import declare, parameter
from tt_core.ros.qos import LATEST
from tt_core.ros.run import run
from tt_core.ros.status import Status

from .choice import ChoiceParams
from .control import ArmControl, ControlParams, warm
from .feasible import check_feasible
from .guard import GuardParams
from .model import BASE, MOUNT, URDF, WAITING, ArmModel
from .reach import ReachParams
from .servo import ServoParams
from .swing import Joints, SwingLimits

TICK = 0.002  # s between the last commands of a node that ends
POINTS = 0.02  # s between the points of the published swing


class ArmNode(Node):
    """strokes and joint states -> velocity commands, the planned swing."""

    def __init__(self) -> None:
        super().__init__("arm")
        base, mount, waiting = (parameter(self, n, list(v)) for n, v in (("base", BASE), ("mount", MOUNT), ("waiting", WAITING)))
        model = ArmModel.pa10(base, mount, waiting, parameter(self, "urdf", str(URDF)))
        self.joints = parameter(self, "joints", list(model.names))
        self.control = ArmControl(
            model,
            declare(self, SwingLimits, "swing."),
            declare(self, ReachParams, "reach."),
            declare(self, ServoParams, "servo."),
            declare(self, GuardParams, "guard."),
            declare(self, ChoiceParams, "choice."),
            declare(self, ControlParams),
        )
        self.status = Status(self)
        self.frame_time: float | None = None  # of the last frame that the coming swing rests on
        self.reason: str | None = None
        warm(model)
        check_feasible(model, self.control.limits)
        self.commands = self.create_publisher(Float64MultiArray, "/arm_velocity_controller/commands", LATEST)
        self.swings = self.create_publisher(JointTrajectory, "/arm_trajectory_controller/joint_trajectory", LATEST)
        self.create_subscription(JointState, "/joint_states", self.on_joints, LATEST)
        self.create_subscription(MultiDOFJointTrajectory, "/racket/strokes", self.on_strokes, LATEST)
        self.create_service(SetBool, "/arm/enable", self.on_enable)
        self.create_service(Trigger, "/arm/stop", self.on_stop)
        self.create_timer(0.02, self.on_watch)
        self.control.enable(parameter(self, "enabled", False))

    def on_joints(self, message: JointState) -> None:
        try:
            step = self.control.step(Joints(*joints_from_message(message, self.joints)), self.now())
        except Exception as error:  # whatever it is, the arm must not move on
            self.fail(error)
            return
        self.commands.publish(Float64MultiArray(data=step.command.tolist()))
        if step.begun is not None:
            self.status.tell("first command", stamp=self.frame_time)
        self.tell(step.reason)

    def on_strokes(self, message: MultiDOFJointTrajectory) -> None:
        try:
            choice = self.control.take(strokes_from_message(message))
        except TtError as error:
            self.status.tell(str(error), warn=True)
            return
        except Exception as error:
            self.fail(error)
            return
        stamp, reasons = seconds(message.header.stamp), "; ".join(choice.reasons)
        if choice.swing is None or choice.reach is None:
            self.status.tell("no swing", stamp=stamp, warn=True, chosen=-1, reasons=reasons)
            return
        self.frame_time = stamp
        self.status.tell(
            "swing",
            stamp=stamp,
            chosen=choice.index,
            strike=f"{choice.swing.strike_time:.6f}",
            earliest=f"{choice.swing.earliest:.6f}",
            ratio=f"{choice.reach.ratio:.3f}",
            turning=f"{choice.reach.turning:.2f}",
            reasons=reasons,
        )
        self.swings.publish(swing_to_message(self.joints, choice.swing.start.time, *choice.swing.table(POINTS)))

    def on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.control.enable(request.data)
        response.success, response.message = True, "enabled" if request.data else "disabled"
        return response

    def on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.control.enable(False, "stopped by /arm/stop")
        response.success, response.message = True, "stopped; /arm/enable starts again"
        return response

    def on_watch(self) -> None:
        """Stops the arm when the joint states have ceased."""
        now = self.now()
        command = self.control.watch(now)
        if command is not None and self.control.joints is not None:
            self.commands.publish(Float64MultiArray(data=command.tolist()))
            self.tell("no joint state in time")

    def now(self) -> float:
        """s, by the node's clock."""
        return self.get_clock().now().nanoseconds * 1e-9

    def tell(self, reason: str | None) -> None:
        """Why the arm does not do what its swing wants, when that changes: in words, but for numbers that change with every look."""
        words = None if reason is None else re.sub(r"[0-9.]+", "", reason)
        if words != self.reason:
            self.reason = words
            self.status.tell(f"guard: {reason or 'nothing to cut'}", warn=reason is not None)

    def fail(self, error: Exception) -> None:
        self.commands.publish(Float64MultiArray(data=self.control.fail(f"failed: {type(error).__name__}: {error}").tolist()))
        self.tell(self.control.guard.latched)
        self.get_logger().error(f"{type(error).__name__}: {error}", throttle_duration_sec=1.0)

    def close(self) -> None:
        """Brings the arm to rest before the context ends, for whatever reason it does."""
        for command in self.control.ending(TICK):
            self.commands.publish(Float64MultiArray(data=command.tolist()))
            time.sleep(TICK)
        self.tell("the node ends")
        self.commands.wait_for_all_acked(Duration(seconds=0.2))


def main() -> None:
    run(ArmNode)


if __name__ == "__main__":
    main()
