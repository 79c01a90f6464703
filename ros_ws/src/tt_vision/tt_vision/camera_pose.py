"""Where a camera stands, as parameters of a node."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from tt_core.params import param

from .camera import Camera


@dataclass(frozen=True)
class CameraPose:
    """Pose of a camera: p_camera = rotation p_table + translation (2.3)."""

    rotation: tuple[float, ...] = param(
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), "", "rotation matrix from `table` to the camera, by rows", low=-1.001, high=1.001
    )
    translation: tuple[float, ...] = param((0.0, 0.0, 0.0), "m", "origin of `table` in the frame of the camera", low=-100.0, high=100.0)

    @classmethod
    def of(cls, camera: Camera) -> CameraPose:
        """Return the pose of a camera."""
        return cls(tuple(camera.rotation.ravel().tolist()), tuple(camera.translation.tolist()))

    def placed(self, camera: Camera) -> Camera:
        """Return the camera at this pose; raises NotARotation."""
        return dataclasses.replace(camera, rotation=np.reshape(self.rotation, (3, 3)), translation=np.array(self.translation))
