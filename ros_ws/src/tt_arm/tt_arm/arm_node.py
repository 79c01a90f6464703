"""The node of the arm: it receives strokes and joint states, and answers each joint state with a joint velocity command.

A stroke is the racket's position, orientation and velocity at one time that returns the ball; a swing is the joint motion that makes it.
Servo and guard run in the executor's thread, in which nothing takes more than a millisecond. Swings are planned in another thread. All
deadlines are measured on the monotonic clock.
"""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from tt_core.errors import TtError
from tt_core.failures import Failure, code_name
from tt_core.params import check, param
from tt_core.priority import CONTROL, IMPROVEMENT, RESPONSE, set_thread_realtime
from tt_core.robots import read_arm
from tt_core.ros.clock_offset import ClockMonitor
from tt_core.ros.convert import StampedStrokes, joints_from_message, swing_to_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import JOINTS_FORM, PUBLISHER_CHECK_INTERVAL, STROKES_FORM, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare
from tt_core.ros.qos import LATCHED, LATEST, NEWEST
from tt_core.ros.refusals import Refusals
from tt_core.states import Array, RacketState

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
END_COMMAND_INTERVAL = 0.002  # s between the last commands of the node when it ends
LONGEST_END = 1.0  # s, longest time for which the node sends these commands
SWING_POINT_INTERVAL = 0.02  # s between the points of the published swing
THREAD_SWITCH_INTERVAL = 5e-4  # s, interval after which the planning thread's Python code yields to the servo
STOP_REPORT_INTERVAL = 0.2  # s, least time between two reports of what stops the arm
NORMAL_REASONS = {
    ArmStop.SWING_WILL_DO,
    ArmStop.SWING_COMMITTED,
}  # normal reasons for newer strokes to change nothing; they are no warnings


class ArmLine(Enum):
    """Messages that the arm node writes to the terminal, as format strings."""

    SWING = "swing: strikes in {ahead:.3f} s, joints at most at {ratio:.0%} of their speed limits"
    NO_SWING = "no swing: {reason}"
    HELD = "held or limited: {reason}"
    FREE = "moves as its swings ask"
    ENABLED = "enabled"
    DISABLED = "disabled"


@dataclass(frozen=True)
class ArmParams(InstalledArm):
    """Parameters of the arm node: the arm, the form of its commands, its speed, and whether it is enabled at the start."""

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
    """ROS node that moves the arm.

    It subscribes to joint_states and racket/strokes. It publishes joint velocity or position commands, the planned swing on arm/swing, and
    the URDF of the arm on robot_description. It serves arm/enable and arm/stop.
    """

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
        sys.setswitchinterval(THREAD_SWITCH_INTERVAL)
        self.strokes: StampedStrokes | None = None  # newest candidate strokes; None once the planning thread has taken them
        self.planned: StampedStrokes | None = None  # candidate strokes that the planning thread has taken last
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
        self.states = Input(self, JOINTS_FORM, "joint_states", self.on_joints, NEWEST, refused=self.on_refused_state)
        self.refused_strokes = Refusals(self.status, "strokes")
        candidates = Input(self, STROKES_FORM, "racket/strokes", self.on_strokes, LATEST, refused=self.refused_strokes)
        self.status.wait_for((self.states, candidates))
        self.clock_offset = params.clock_offset
        self.clocks = ClockMonitor(self, self.status, self.clock_offset)
        self.worst_clock = self.clocks.worst()
        self.create_service(SetBool, "arm/enable", self.on_enable)
        self.create_service(Trigger, "arm/stop", self.on_stop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCH, self.on_watch, clock=steady)
        self.create_timer(PUBLISHER_CHECK_INTERVAL, self.check_other_publishers, clock=steady)
        self.control.enable(params.enabled)
        threading.Thread(target=self.plan, name="planning", daemon=True).start()

    def _in_simulated_time(self, params: JointStateParams) -> JointStateParams:
        """Return the deadlines in simulated seconds.

        If simulated time passes faster than real time, a delay of this computer lasts more simulated seconds, so the deadlines are longer.
        """
        if self.rtf <= 1.0:
            return params
        return replace(params, silence=params.silence * self.rtf, late=params.late * self.rtf, ahead=params.ahead * self.rtf)

    def on_params(self, params: ArmParams) -> None:
        """Apply the parameters that can be changed at run time: the share of the speed limits."""
        self.control.speed_scale = params.speed_scale

    def on_joints(self, message: JointState) -> None:
        """Compute and publish the command that answers a joint state. Stop the arm if the message is invalid or an error occurs."""
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
        """Publish a command that brakes, because the position of the arm is unknown if a joint state cannot be read."""
        self.send(self.control.refuse(self.monotonic(), Failure(ArmStop.UNREADABLE, error=error)))

    def on_watch(self) -> None:
        """Publish a command that brakes if valid joint states have ceased; called by a timer every WATCH seconds."""
        step = self.control.watch(self.monotonic())
        if step is not None:
            self.send(step)

    def send(self, step: ControlStep) -> None:
        """Publish the command of a control step, and report a begun swing, an interrupted stroke or the reason of a stop."""
        self.command(step.command)
        if step.begun is not None and self.frame_time is not None:
            stamp, self.frame_time = self.frame_time, None
            self.status.publish(Event.FIRST_COMMAND, stamp=stamp)
        if step.interrupted:  # the stroke may still be made from where the arm is now
            self.strokes = self.strokes or self.planned
            self.arrival.set()
        self.publish_stop(step.reason)

    def command(self, command: Array) -> None:
        """Publish a joint velocity command in the form that the driver takes: velocities, or positions of a short trajectory.

        Positions are published only if there is a valid joint state.

        Args:
            command: (n,) rad/s or m/s.
        """
        if self.stream is None:
            self.commands.publish(Float64MultiArray(data=command.tolist()))
        elif self.control.joints is not None:
            points = self.stream.points(self.monotonic(), self.control.joints.q, command)
            self.commands.publish(swing_to_message(self.joints, 0.0, *points))  # a stamp of 0: from the time of arrival on

    def on_strokes(self, strokes: StampedStrokes) -> None:
        """Pass candidate strokes to the planning thread; they replace older ones for which no swing is planned yet."""
        self.strokes = strokes
        self.arrival.set()

    def plan(self) -> None:
        """Plan swings for the newest candidate strokes whenever some arrive, until the node ends; the function of the planning thread."""
        set_thread_realtime(RESPONSE.realtime)  # less urgent than the thread that sends commands
        while True:
            self.arrival.wait()
            self.arrival.clear()
            if self.ending:
                return
            strokes, self.strokes = self.strokes, None
            if strokes is None:
                continue
            self.planned = strokes
            try:
                self.take(*strokes)
            except TtError as error:
                self.refused_strokes(error)
            except Exception as error:  # the servo goes on without a new plan
                if not self.ending:
                    failure = Failure(ArmStop.PLANNING_FAILED, error=f"{type(error).__name__}: {error}")
                    self.get_logger().error(str(failure), throttle_duration_sec=1.0)
                    self.report_no_swing(strokes.time, failure)

    def take(self, stamp: float, rackets: list[RacketState]) -> None:
        """Plan a swing for candidate strokes, and publish it, or the reasons why there is none.

        Raises TtError for strokes that cannot be used.

        Args:
            stamp: s, of the last frame that the strokes are based on.
            rackets: The candidates in order of preference.
        """
        failure = self.wrong_clock(stamp)
        if failure is not None:
            self.report_no_swing(stamp, failure)
            self.status.terminal.warn(ArmLine.NO_SWING, reason=failure)
            return
        self.frame_time = stamp  # set before the plan: the servo thread may begin the swing before `take` returns
        try:
            selected = self.control.take(rackets, self.may_improve)
        finally:
            set_thread_realtime(RESPONSE.realtime)
        first, reasons = (selected.reasons[0].failure if selected.reasons else None), "; ".join(map(str, selected.reasons))
        if selected.swing is None or selected.reach is None:
            is_kept = selected.refused is not None and selected.refused.code in NORMAL_REASONS
            self.status.publish(Event.NO_SWING, stamp=stamp, warn=not is_kept, reason=first, chosen=-1, reasons=reasons)
            if not is_kept:
                self.status.terminal.warn(ArmLine.NO_SWING, reason=reasons)
            return
        self.status.publish(
            Event.SWING,
            stamp=stamp,
            reason=first,
            chosen=selected.index,
            corrects=selected.corrects,
            strike=f"{selected.swing.strike_time:.6f}",
            earliest=f"{selected.swing.earliest:.6f}",
            ratio=f"{selected.reach.ratio:.3f}",
            turning=f"{selected.reach.turning:.2f}",
            reasons=reasons,
        )
        self.status.terminal.info(ArmLine.SWING, ahead=selected.swing.strike_time - self.now(), ratio=selected.reach.ratio)
        self.swings.publish(swing_to_message(self.joints, selected.swing.start.time, *selected.swing.table(SWING_POINT_INTERVAL)))

    def may_improve(self) -> bool:
        """Return whether no newer strokes wait, so that a planned swing may be improved; other work is more urgent than that."""
        set_thread_realtime(IMPROVEMENT.realtime)
        return self.strokes is None

    def report_no_swing(self, stamp: float, failure: Failure) -> None:
        """Publish why strokes that rest on a frame of `stamp` (s) are not tried."""
        self.status.publish(Event.NO_SWING, stamp=stamp, warn=True, reason=failure, chosen=-1, reasons=failure)

    def wrong_clock(self, stamp: float) -> Failure | None:
        """Return why strokes would be made at a wrong time because a clock is wrong; None if no clock is.

        Args:
            stamp: s, time stamp of the image from which the strokes were computed.
        """
        bound, worst = self.control.states.params.ahead, self.worst_clock
        if stamp > self.now() + bound:
            return Failure(ArmStop.STROKES_AHEAD, age=stamp - self.now(), bound=bound)
        if worst is not None and worst.least > self.clock_offset:
            return Failure(ArmStop.CLOCK_OFFSET, source=worst.source, offset=worst.offset, bound=self.clock_offset)
        return None

    @property
    def kept_parameters(self) -> dict[str, Any] | None:
        """Parameters that a new process gets after a standstill: an enabled arm stays enabled. None while the arm is latched."""
        return None if self.control.guard.latched else {"enabled": self.control.enabled}

    def on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Serve arm/enable: switch the motion of the arm on or off."""
        self.control.enable(request.data)
        self.status.terminal.info(ArmLine.ENABLED if request.data else ArmLine.DISABLED)
        response.success, response.message = True, "enabled" if request.data else "disabled"
        return response

    def on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Serve arm/stop: stop the arm until it is enabled again."""
        self.control.enable(False, Failure(ArmStop.STOPPED))
        response.success, response.message = True, str(Failure(ArmStop.STOPPED))
        return response

    def check_other_publishers(self) -> None:
        """Stop the arm while another node publishes commands or joint states, and find the clock with the largest offset.

        A timer calls it every PUBLISHER_CHECK_INTERVAL seconds.
        """
        for topic in (self.commands.topic_name, self.states.topic):
            publishers = self.get_publishers_info_by_topic(topic)
            failure = None
            if len(publishers) > 1:
                names = ", ".join(sorted(f"{p.node_namespace.rstrip('/')}/{p.node_name}" for p in publishers))
                failure = Failure(ArmStop.SECOND_PUBLISHER, count=len(publishers), topic=topic, names=names)
            self.control.hold(topic, failure)
        self.worst_clock = self.clocks.worst()

    def now(self) -> float:
        """Return the time (s) of the node's clock."""
        return self.get_clock().now().nanoseconds * 1e-9

    def monotonic(self) -> float:
        """Return the time (s) of the monotonic clock, in simulated seconds if time is simulated."""
        return time.monotonic() * self.rtf

    def publish_stop(self, reason: Failure | None) -> None:
        """Report what stops or limits the arm, if it has changed since the last report, at most every STOP_REPORT_INTERVAL seconds.

        Args:
            reason: Why the command differs from what the swing asks for; None if it does not.
        """
        code, now = code_name(reason), time.monotonic()
        if code != self.reported and now > self.reported_at + STOP_REPORT_INTERVAL:
            self.reported, self.reported_at = code, now
            text, latched = f"guard: {reason or 'nothing to cut'}", self.control.guard.latched is not None
            self.status.publish(text, warn=reason is not None, error=latched, reason=reason, code=code)
            if reason is None:
                self.status.terminal.info(ArmLine.FREE)
            else:
                self.status.terminal.warn(ArmLine.HELD, reason=reason)

    def close(self) -> None:
        """Stop the arm with a controlled stop, end the planning thread, and wait until the last commands are sent."""
        failure, end = Failure(ArmStop.ENDED), time.monotonic() + LONGEST_END
        self.control.enable(False, failure)
        while time.monotonic() < end:
            command = self.control.refuse(self.monotonic(), failure).command
            self.command(command)
            if not command.any():
                break
            time.sleep(END_COMMAND_INTERVAL)
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
