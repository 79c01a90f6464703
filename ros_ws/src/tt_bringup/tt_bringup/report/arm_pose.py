"""Where the joints of a recorded arm and its racket are, and its limits, from its URDF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from tt_core.errors import TtError
from tt_core.states import Array

RACKET = "racket"  # frame of the racket in the URDF


class ArmPose:
    """The arm of a recording.

    Attributes:
        speed_limits: (joints,) rad/s or m/s.
        position_limits: (joints, 2) rad or m; infinite where the URDF has none.
    """

    def __init__(self, urdf: str, joint_names: Sequence[str]) -> None:
        """Read a URDF whose root link stands in the origin of `table`.

        Args:
            urdf: The description of the robot.
            joint_names: Of the recorded joints, in their order.

        Raises:
            TtError: It is no URDF, or has no such joint or no frame `racket`.
        """
        try:
            self._model = pin.buildModelFromXML(urdf)
        except (ValueError, RuntimeError) as error:
            raise TtError(f"the robot description cannot be read: {error}") from error
        missing = [name for name in joint_names if not self._model.existJointName(name)]
        if missing or not self._model.existFrame(RACKET):
            raise TtError(f"the robot description has no {', '.join([*missing, RACKET][:3])}")
        self._data = self._model.createData()
        self._joints = [self._model.joints[self._model.getJointId(name)] for name in joint_names]
        self._ids = [self._model.getJointId(name) for name in joint_names]
        self._racket = self._model.getFrameId(RACKET)
        self.speed_limits = np.array([float(self._model.velocityLimit[joint.idx_v]) for joint in self._joints])
        low, high = self._model.lowerPositionLimit, self._model.upperPositionLimit
        self.position_limits = np.array(
            [(low[joint.idx_q], high[joint.idx_q]) if joint.nq == 1 else (-np.inf, np.inf) for joint in self._joints]
        )

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """Return where the arm is at joint positions q (joints,), rad or m.

        Returns:
            The line from joint to joint to the racket, (joints + 1, 3) m, the middle of the racket, (3,) m, and its rotation, (3, 3).
        """
        full = pin.neutral(self._model)
        for joint, value in zip(self._joints, q, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pin.framesForwardKinematics(self._model, self._data, full)
        racket = self._data.oMf[self._racket]
        line = [self._data.oMi[joint].translation for joint in self._ids]
        return np.array([*line, racket.translation]), racket.translation.copy(), racket.rotation.copy()
