"""Parameters of the simulator itself. Those of launcher, arm, drives and models are in the modules of these."""

from __future__ import annotations

from dataclasses import dataclass

from tt_core.errors import TtError
from tt_core.params import check, param

from .world.launcher import shot


@dataclass(frozen=True)
class SimParams:
    """Parameters of the simulation: what is simulated, how fast and in which steps."""

    rtf: float = param(1.0, "", "simulated seconds per real second", low=0.01, high=10.0)
    seed: int = param(0, "", "seed of all random numbers of the simulator", low=0, high=2**31)
    robot: str = param("", "", "name of an arm, or path of an arm file or its folder, see docs/arms.md; empty: pa10")
    world: str = param("", "", "name or path of a world file; empty: the parameters physics, air.*, table.*, racket.* and plant.* apply")
    shots: tuple[str, ...] = param(
        ("top 3", "back 3", "left 3", "top 5", "back 4", "right 4"), "", "kind and scale of each launch, in turn", dynamic=True
    )
    tick: float = param(0.002, "s", "period of the joint states and of the simulation of the arm", low=0.0005, high=0.02)
    clock_rate: float = param(250.0, "1/s", "rate of /clock", low=1.0, high=1000.0)
    lead: float = param(0.05, "s", "time from the images of a ball being ready to its launch", low=0.0, high=5.0)
    always_on: bool = param(False, "", "whether the cameras publish frames without a ball too")
    step: float = param(0.02, "s", "simulated time that passes in a step, the service sim/step", low=0.0005, high=10.0, dynamic=True)
    repeat: int = param(0, "", "number of launches after which the same launches begin again; 0: never", low=0, high=1000000)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and shots that there are not."""
        check(self)
        if not self.shots:
            raise TtError("shots = () is empty")
        self.all_shots  # noqa: B018  # raises for a shot that there is not

    @property
    def all_shots(self) -> list[tuple[str, int]]:
        """Kind and scale of each shot, e.g. ("top", 3).

        Raises:
            TtError: A text is not a kind and a scale, or there is no such kind or scale.
        """
        return [shot(text) for text in self.shots]
