"""Compute where the joints and the racket of a recorded arm are, from its URDF and its joint positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from tt_arm.arm_urdf.urdf import RACKET_LINK
from tt_core.errors import TtError
from tt_core.states import Array


class ArmPose:
    """Kinematics and limits of the arm of a recording.

    Attributes:
        speed_limits: (joints,) speed limits, rad/s or m/s.
        position_limits: (joints, 2) lowest and highest positions, rad or m; infinite if the URDF has none.
    """

    def __init__(self, urdf: str, joint_names: Sequence[str]) -> None:
        """Read a URDF.

        Args:
            urdf: Text of the URDF, whose root link is at the origin of the frame `table`.
            joint_names: Names of the recorded joints, in the order of the recorded positions.

        Raises:
            TtError: The text is no URDF, or lacks one of the joints or the frame `racket`.
        """
        try:
            self._model = pin.buildModelFromXML(urdf)
        except (ValueError, RuntimeError) as error:
            raise TtError(f"the robot description cannot be read: {error}") from error
        missing = [name for name in joint_names if not self._model.existJointName(name)]
        if missing or not self._model.existFrame(RACKET_LINK):
            raise TtError(f"the robot description has no joint or link named {', '.join([*missing, RACKET_LINK][:3])}")
        self._data = self._model.createData()
        self._joints = [self._model.joints[self._model.getJointId(name)] for name in joint_names]
        self._ids = [self._model.getJointId(name) for name in joint_names]
        self._racket = self._model.getFrameId(RACKET_LINK)
        self.speed_limits = np.array([float(self._model.velocityLimit[joint.idx_v]) for joint in self._joints])
        low, high = self._model.lowerPositionLimit, self._model.upperPositionLimit
        self.position_limits = np.array(
            [(low[joint.idx_q], high[joint.idx_q]) if joint.nq == 1 else (-np.inf, np.inf) for joint in self._joints]
        )

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """Return where the arm is at joint positions q, (joints,) rad or m.

        Returns:
            Three arrays in the frame `table`: the positions of the joints and then of the racket, (joints + 1, 3) m; the centre of the
            racket's face, (3,) m; the rotation matrix of the racket, `racket` to `table`, (3, 3).
        """
        full = pin.neutral(self._model)
        for joint, value in zip(self._joints, q, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pin.framesForwardKinematics(self._model, self._data, full)
        racket = self._data.oMf[self._racket]
        line = [self._data.oMi[joint].translation for joint in self._ids]
        return np.array([*line, racket.translation]), racket.translation.copy(), racket.rotation.copy()
