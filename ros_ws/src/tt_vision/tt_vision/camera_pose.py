"""The pose of a camera, as parameters of a node."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from tt_core.params import param

from .camera import Camera


@dataclass(frozen=True)
class CameraPose:
    """Pose of a camera, as parameters of a node.

    A point p_table in the frame `table` is p_camera = rotation p_table + translation in the camera's frame (equation (2.3) of the
    dissertation).

    Attributes:
        rotation: (9,), the rotation matrix from `table` to the camera's frame, row by row.
        translation: (3,) m, the origin of `table` in the camera's frame.
    """

    rotation: tuple[float, ...] = param(
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), "", "rotation matrix from `table` to the camera, by rows", low=-1.001, high=1.001
    )
    translation: tuple[float, ...] = param((0.0, 0.0, 0.0), "m", "origin of `table` in the frame of the camera", low=-100.0, high=100.0)

    @classmethod
    def of(cls, camera: Camera) -> CameraPose:
        """Return the pose of the given camera."""
        return cls(tuple(camera.rotation.ravel().tolist()), tuple(camera.translation.tolist()))

    def placed(self, camera: Camera) -> Camera:
        """Return a copy of the camera that stands at this pose.

        Args:
            camera: Gives all intrinsics; its own pose is not used.

        Raises:
            NotARotation: `rotation` is not a rotation matrix.
        """
        return dataclasses.replace(camera, rotation=np.reshape(self.rotation, (3, 3)), translation=np.array(self.translation))
