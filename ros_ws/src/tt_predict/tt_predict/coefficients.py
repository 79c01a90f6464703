"""Coefficients of air and table by name, "air.drag" and the like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from tt_core.arrays import Array
from tt_core.bounce import TableRebound
from tt_core.errors import BadChoice, TtError
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics

LEAST_SCALE = 0.05  # of a coefficient in the fit
RANGES = {
    f"{prefix}.{f.name}": (f.metadata["low"], f.metadata["high"])
    for prefix, model in (("air", Aerodynamics), ("table", TableRebound))
    for f in fields(model)
}


class NoFlights(TtError):
    """Nothing to identify from."""

    def __init__(self) -> None:
        super().__init__("no flight to identify from")


def coefficient(physics: Physics, name: str) -> float:
    """Return the coefficient of a name, "air.drag" and the like.

    Raises:
        BadChoice: There is no coefficient of that name.
    """
    if name not in RANGES:
        raise BadChoice("coefficient", name, tuple(RANGES))
    part, _, field = name.partition(".")
    return float(getattr(getattr(physics, part), field))


def with_coefficients(physics: Physics, names: Sequence[str], values: Sequence[float] | Array) -> Physics:
    """Return the models with other values of the coefficients `names`."""
    for name, value in zip(names, values, strict=True):
        part, _, field = name.partition(".")
        physics = replace(physics, **{part: replace(getattr(physics, part), **{field: float(value)})})
    return physics
