"""Coefficients survive the way through text, and nonsense is refused by name."""

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from tt_core.errors import BadChoice, NotFinite, OutOfRange, TtError
from tt_core.factors import scaled
from tt_core.learnt_physics import PHYSICS_NODES, physics_from_text, physics_to_text
from tt_core.physics import Physics

PHYSICS = Physics.measured()


@given(st.lists(st.floats(-0.1, 0.1), min_size=7, max_size=7), st.sampled_from(PHYSICS_NODES))
def test_models_are_the_same_after_text(logarithms, node):
    physics = scaled(PHYSICS, logarithms)
    text = physics_to_text(physics, "measured")
    assert physics_from_text(text, node, Physics.liu()) == physics
    assert yaml.safe_load(text)[f"/**/{node}"]["ros__parameters"]["physics"] == "measured"


def test_what_a_text_does_not_name_stays():
    found = physics_from_text("/**/predict:\n  ros__parameters:\n    air.drag: 0.4\n", "predict", PHYSICS)
    assert found.air.drag == 0.4 and found.table == PHYSICS.table and found.racket == PHYSICS.racket


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("air.drag: 9.0", OutOfRange),
        ("air.drag: .nan", NotFinite),
        ("air.drag: soon", NotFinite),
        ("air.drag: true", NotFinite),
        ("air.colour: 1.0", BadChoice),
        ("moon.drag: 1.0", BadChoice),
    ],
)
def test_wrong_coefficients_are_refused(line, error):
    with pytest.raises(error):
        physics_from_text(f"/**/predict:\n  ros__parameters:\n    {line}\n", "predict", PHYSICS)


@given(st.text(max_size=200))
def test_any_other_text_is_refused(text):
    with pytest.raises(TtError):
        physics_from_text(text, "predict", PHYSICS)


def test_other_nodes_and_long_texts_are_refused():
    for text in (physics_to_text(PHYSICS, "measured", ["racket"]), " " * 30_000, "[" * 5000, "/**/predict: 3"):
        with pytest.raises(TtError):
            physics_from_text(text, "predict", PHYSICS)
    assert np.isfinite(PHYSICS.coefficients).all()
