"""Access to the coefficients of the models of air and table by name, for example "air.drag" or "table.friction"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from tt_core.arrays import Array
from tt_core.bounce import TableRebound
from tt_core.errors import BadChoice, TtError
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics

LEAST_SCALE = 0.05  # least scale of a coefficient in a fit, for coefficients that are near 0
RANGES = {
    f"{prefix}.{f.name}": (f.metadata["low"], f.metadata["high"])
    for prefix, model in (("air", Aerodynamics), ("table", TableRebound))
    for f in fields(model)
}


class NoFlights(TtError):
    """There is no flight from which coefficients could be identified."""

    def __init__(self) -> None:
        super().__init__("no flight to identify from")


def coefficient(physics: Physics, name: str) -> float:
    """Return the value of one coefficient.

    Args:
        physics: Models of air, table and racket.
        name: Name of a coefficient of air or table, for example "air.drag".

    Raises:
        BadChoice: There is no coefficient of that name.
    """
    if name not in RANGES:
        raise BadChoice("coefficient", name, tuple(RANGES))
    part, _, field = name.partition(".")
    return float(getattr(getattr(physics, part), field))


def with_coefficients(physics: Physics, names: Sequence[str], values: Sequence[float] | Array) -> Physics:
    """Return the models with some coefficients replaced.

    Args:
        physics: Models of air, table and racket.
        names: Names of the coefficients to replace, for example "air.drag".
        values: Their new values, in the same order.
    """
    for name, value in zip(names, values, strict=True):
        part, _, field = name.partition(".")
        physics = replace(physics, **{part: replace(getattr(physics, part), **{field: float(value)})})
    return physics
