"""The node of the arm: it receives strokes and joint states, and answers each joint state with a joint velocity command.

Guard and servo run in the executor's thread, which does nothing that takes more than a millisecond. Strokes are planned in a thread of
their own. All deadlines run on the monotonic clock.
"""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.failures import Failure, code_name
from tt_core.params import check, param
from tt_core.priority import CONTROL, RESPONSE, set_thread_realtime
from tt_core.robots import read_arm
from tt_core.ros.clock_offset import ClockMonitor
from tt_core.ros.convert import joints_from_message, seconds, strokes_from_message, swing_to_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare
from tt_core.ros.qos import LATCHED, LATEST, NEWEST
from tt_core.ros.refusals import Refusals
from tt_core.states import Array

from .arm_file import InstalledArm
from .control import ArmControl, ControlParams, ControlStep, warm
from .joints import Joints
from .position_stream import LONGEST_AHEAD, PositionStream
from .reach import ReachParams
from .safety.guard import GuardParams
from .safety.joint_states import JointStateParams
from .safety.stops import ArmStop
from .servo import ServoParams
from .startup_check import check_feasible, check_guard
from .stroke_selection import SelectionParams
from .swing import SwingLimits

WATCH = 0.0025  # s between two checks whether joint states have ceased
LOOK = 0.25  # s between two checks who else publishes commands or joint states
TICK = 0.002  # s between the last commands of a node that ends
LONGEST_END = 1.0  # s, that these commands may take
POINTS = 0.02  # s between the points of the published swing
SWITCH = 5e-4  # s, after which the planning thread's Python code yields to the servo
TELL = 0.2  # s, at least, between two reports of what stops the arm
KEPT = {ArmStop.SWING_WILL_DO, ArmStop.SWING_COMMITTED}  # why newer strokes change nothing, as they should
LARGEST_STATE, LARGEST_STROKES = 1 << 16, 1 << 15  # bytes of a message; 500 joints, 128 strokes


class ArmLine(Enum):
    """What the terminal tells."""

    SWING = "swing: strikes in {ahead:.3f} s, joints at most at {ratio:.0%} of their speed limits"
    NO_SWING = "no swing: {reason}"
    HELD = "held or limited: {reason}"
    FREE = "moves as its swings ask"
    ENABLED = "enabled"
    DISABLED = "disabled"


@dataclass(frozen=True)
class ArmParams(InstalledArm):
    """The arm, and what it may do."""

    commands: str = param(
        "velocity",
        "",
        "what the driver takes: velocities on arm_velocity_controller/commands, or positions on arm_trajectory_controller/joint_trajectory",
        choices=("velocity", "trajectory"),
    )
    stream_ahead: float = param(
        0.02, "s", "time for which the positions of `commands: trajectory` lead on; then they brake", low=0.001, high=LONGEST_AHEAD
    )
    rtf: float = param(1.0, "", "simulated seconds that pass in one second", low=0.01, high=10.0)
    speed_scale: float = param(
        1.0, "", "share of the speed limits that the arm may use; acts while the arm moves", low=0.01, high=1.0, dynamic=True
    )
    clock_offset: float = param(0.002, "s", "offset of another node's clock above which strokes are refused", low=1e-4, high=10.0)
    enabled: bool = param(False, "", "whether the arm may move from the start, without a call of arm/enable")

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class ArmNode(Node):
    """Subscribe to joint states and strokes; publish commands, the planned swing and the description of the arm."""

    def __init__(self) -> None:
        """Declare the parameters, check the arm, load the kernels, and connect."""
        super().__init__("arm")
        params = declare(self, ArmParams, changed=self.on_params)
        model = params.model()
        drives, _ = read_arm(params.robot)
        guard = declare(self, GuardParams, "guard.")
        self.joints = params.joint_names(model)
        self.rtf = params.rtf
        self.about = f"robot {model.pinocchio.name} with {len(self.joints)} joints"
        self.control = ArmControl(
            model,
            declare(self, SwingLimits(command_timeout=drives.command_timeout), "swing."),
            declare(self, ReachParams, "reach."),
            declare(self, ServoParams, "servo."),
            guard,
            declare(self, SelectionParams, "selection."),
            declare(self, ControlParams),
            self._in_simulated_time(declare(self, JointStateParams, "states.")),
        )
        self.on_params(params)
        self.status = Status(self, hardware=model.pinocchio.name)
        self.frame_time: float | None = None  # of the last frame that the coming swing rests on; None once its first command is told
        self.reported, self.reported_at = code_name(None), 0.0  # code of what was last reported to stop the arm, and when (s, monotonic)
        warm(model)
        check_feasible(model, self.control.limits)
        check_guard(model, self.control.limits, guard)
        sys.setswitchinterval(SWITCH)
        self.strokes: MultiDOFJointTrajectory | None = None  # the newest, for the planning thread
        self.planned: MultiDOFJointTrajectory | None = None  # those that it took last
        self.arrival, self.ending = threading.Event(), False
        self.stream: PositionStream | None = None
        if params.commands == "trajectory":
            self.stream = PositionStream(self.control.limits.of_joints(model).acceleration, params.stream_ahead)
            self.commands = self.create_publisher(JointTrajectory, "arm_trajectory_controller/joint_trajectory", LATEST)
        else:
            self.commands = self.create_publisher(Float64MultiArray, "arm_velocity_controller/commands", LATEST)
        self.swings = self.create_publisher(JointTrajectory, "arm/swing", LATEST)
        self.description = self.create_publisher(String, "robot_description", LATCHED)
        self.description.publish(String(data=model.placed_description))
        self.states = Input(self, JointState, "joint_states", self.on_joints, NEWEST, largest=LARGEST_STATE, refused=self.on_refused_state)
        self.refused_strokes = Refusals(self.status, "strokes")
        candidates = Input(
            self,
            MultiDOFJointTrajectory,
            "racket/strokes",
            self.on_strokes,
            LATEST,
            largest=LARGEST_STROKES,
            refused=self.refused_strokes,
        )
        self.status.wait_for((self.states, candidates))
        self.clock_offset = params.clock_offset
        self.clocks = ClockMonitor(self, self.status, self.clock_offset)
        self.worst_clock = self.clocks.worst()
        self.create_service(SetBool, "arm/enable", self.on_enable)
        self.create_service(Trigger, "arm/stop", self.on_stop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCH, self.on_watch, clock=steady)
        self.create_timer(LOOK, self.on_look, clock=steady)
        self.control.enable(params.enabled)
        threading.Thread(target=self.plan, name="planning", daemon=True).start()

    def _in_simulated_time(self, params: JointStateParams) -> JointStateParams:
        """Return the deadlines in simulated seconds: where these pass faster, a delay of this machine lasts more of them."""
        if self.rtf <= 1.0:
            return params
        return replace(params, silence=params.silence * self.rtf, late=params.late * self.rtf, ahead=params.ahead * self.rtf)

    def on_params(self, params: ArmParams) -> None:
        """Apply what acts at run time."""
        self.control.speed_scale = params.speed_scale

    def on_joints(self, message: JointState) -> None:
        """Answer a joint state with a command."""
        now, clock = self.monotonic(), self.now()
        try:
            state = joints_from_message(message, self.joints)
            if state is None:  # it is of other joints
                return
            stamp, q, qdot = state
            joints = Joints(stamp, q, np.zeros(len(q)) if qdot is None else qdot)
            step = self.control.step(joints, now, clock, has_speeds=qdot is not None)
        except TtError as error:
            self.on_refused_state(error)
            return
        except Exception as error:  # whatever it is, the arm must stop
            self.command(self.control.fail(error, now))
            self.get_logger().error(f"{type(error).__name__}: {error}", throttle_duration_sec=1.0)
            self.publish_stop(self.control.guard.latched)
            return
        self.send(step)

    def on_refused_state(self, error: TtError) -> None:
        """Brake, because a joint state that cannot be read does not tell where the arm is."""
        self.send(self.control.refuse(self.monotonic(), Failure(ArmStop.UNREADABLE, error=error)))

    def on_watch(self) -> None:
        """Brake when joint states have ceased."""
        step = self.control.watch(self.monotonic())
        if step is not None:
            self.send(step)

    def send(self, step: ControlStep) -> None:
        """Publish a command, and what is to be reported with it."""
        self.command(step.command)
        if step.begun is not None and self.frame_time is not None:
            stamp, self.frame_time = self.frame_time, None
            self.status.publish(Event.FIRST_COMMAND, stamp=stamp)
        if step.interrupted:  # the stroke may still be made from where the arm is now
            self.strokes = self.strokes or self.planned
            self.arrival.set()
        self.publish_stop(step.reason)

    def command(self, command: Array) -> None:
        """Publish a velocity command (n,), rad/s or m/s, as the arm takes it: as it is, or as positions, once there are joint states."""
        if self.stream is None:
            self.commands.publish(Float64MultiArray(data=command.tolist()))
        elif self.control.joints is not None:
            points = self.stream.points(self.monotonic(), self.control.joints.q, command)
            self.commands.publish(swing_to_message(self.joints, 0.0, *points))  # a stamp of 0: from the time of arrival on

    def on_strokes(self, message: MultiDOFJointTrajectory) -> None:
        """Pass strokes to the planning thread. Older ones that it has not taken yet are replaced."""
        self.strokes = message
        self.arrival.set()

    def plan(self) -> None:
        """Take the newest strokes whenever some come, in the planning thread."""
        set_thread_realtime(RESPONSE.realtime)  # less urgent than the thread that sends commands
        while True:
            self.arrival.wait()
            self.arrival.clear()
            if self.ending:
                return
            message, self.strokes = self.strokes, None
            if message is None:
                continue
            self.planned = message
            try:
                self.take(message)
            except TtError as error:
                self.refused_strokes(error)
            except Exception as error:  # the servo goes on without a new plan
                if not self.ending:
                    failure = Failure(ArmStop.PLANNING_FAILED, error=f"{type(error).__name__}: {error}")
                    self.get_logger().error(str(failure), throttle_duration_sec=1.0)
                    self.tell_no_swing(seconds(message.header.stamp), failure)

    def take(self, message: MultiDOFJointTrajectory) -> None:
        """Plan for strokes, and publish the swing or why there is none."""
        stamp = seconds(message.header.stamp)
        failure = self.wrong_clock(stamp)
        if failure is not None:
            self.tell_no_swing(stamp, failure)
            self.status.terminal.warn(ArmLine.NO_SWING, reason=failure)
            return
        self.frame_time = stamp  # set before the plan: the servo thread may begin the swing before `take` returns
        selected = self.control.take(strokes_from_message(message))
        first, reasons = (selected.reasons[0].failure if selected.reasons else None), "; ".join(map(str, selected.reasons))
        if selected.swing is None or selected.reach is None:
            is_kept = selected.refused is not None and selected.refused.code in KEPT
            self.status.publish(Event.NO_SWING, stamp=stamp, warn=not is_kept, reason=first, chosen=-1, reasons=reasons)
            if not is_kept:
                self.status.terminal.warn(ArmLine.NO_SWING, reason=reasons)
            return
        self.status.publish(
            Event.SWING,
            stamp=stamp,
            reason=first,
            chosen=selected.index,
            strike=f"{selected.swing.strike_time:.6f}",
            earliest=f"{selected.swing.earliest:.6f}",
            ratio=f"{selected.reach.ratio:.3f}",
            turning=f"{selected.reach.turning:.2f}",
            reasons=reasons,
        )
        self.status.terminal.info(ArmLine.SWING, ahead=selected.swing.strike_time - self.now(), ratio=selected.reach.ratio)
        self.swings.publish(swing_to_message(self.joints, selected.swing.start.time, *selected.swing.table(POINTS)))

    def tell_no_swing(self, stamp: float, failure: Failure) -> None:
        """Publish why strokes that rest on a frame of `stamp` (s) are not tried."""
        self.status.publish(Event.NO_SWING, stamp=stamp, warn=True, reason=failure, chosen=-1, reasons=failure)

    def wrong_clock(self, stamp: float) -> Failure | None:
        """Return why strokes that rest on a frame of `stamp` (s) would be made at a wrong time, or None."""
        bound, worst = self.control.states.params.ahead, self.worst_clock
        if stamp > self.now() + bound:
            return Failure(ArmStop.STROKES_AHEAD, age=stamp - self.now(), bound=bound)
        if worst is not None and worst.least > self.clock_offset:
            return Failure(ArmStop.CLOCK_OFFSET, source=worst.source, offset=worst.offset, bound=self.clock_offset)
        return None

    def on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Switch motion on or off, the service arm/enable."""
        self.control.enable(request.data)
        self.status.terminal.info(ArmLine.ENABLED if request.data else ArmLine.DISABLED)
        response.success, response.message = True, "enabled" if request.data else "disabled"
        return response

    def on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop the arm until it is enabled again, the service arm/stop."""
        self.control.enable(False, Failure(ArmStop.STOPPED))
        response.success, response.message = True, str(Failure(ArmStop.STOPPED))
        return response

    def on_look(self) -> None:
        """Stop the arm while another node publishes commands or joint states; find the clock that is off most."""
        for topic in (self.commands.topic_name, self.states.topic):
            publishers = self.get_publishers_info_by_topic(topic)
            failure = None
            if len(publishers) > 1:
                names = ", ".join(sorted(f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in publishers))
                failure = Failure(ArmStop.SECOND_PUBLISHER, count=len(publishers), topic=topic, names=names)
            self.control.hold(topic, failure)
        self.worst_clock = self.clocks.worst()

    def now(self) -> float:
        """Return the time (s) by the node's clock."""
        return self.get_clock().now().nanoseconds * 1e-9

    def monotonic(self) -> float:
        """Return the time (s) by the monotonic clock, in simulated seconds where time is simulated."""
        return time.monotonic() * self.rtf

    def publish_stop(self, reason: Failure | None) -> None:
        """Report what stops the arm, or makes it do less than its swing asks, when that changes, at most each TELL (s)."""
        code, now = code_name(reason), time.monotonic()
        if code != self.reported and now > self.reported_at + TELL:
            self.reported, self.reported_at = code, now
            self.status.publish(f"guard: {reason or 'nothing to cut'}", warn=reason is not None, reason=reason, code=code)
            if reason is None:
                self.status.terminal.info(ArmLine.FREE)
            else:
                self.status.terminal.warn(ArmLine.HELD, reason=reason)

    def close(self) -> None:
        """Bring the arm to rest before the context ends."""
        failure, end = Failure(ArmStop.ENDED), time.monotonic() + LONGEST_END
        self.control.enable(False, failure)
        while time.monotonic() < end:
            command = self.control.refuse(self.monotonic(), failure).command
            self.command(command)
            if not command.any():
                break
            time.sleep(TICK)
        self.ending = True
        self.arrival.set()
        self.reported_at = 0.0
        self.publish_stop(failure)
        self.commands.wait_for_all_acked(Duration(seconds=0.2))


def main() -> None:
    """Run the node."""
    run(ArmNode, CONTROL)


if __name__ == "__main__":
    main()
