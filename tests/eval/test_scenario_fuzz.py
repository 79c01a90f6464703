"""Whatever a YAML file holds, loading it gives an instance or BadFile; and a valid scenario is the same again from its own values."""

from dataclasses import asdict, fields

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from tt_core.strict_yaml import MOST_YAML_BYTES, BadFile, build, read_yaml
from tt_eval.scenario import Robot, Scenario
from tt_racket.intercept import InterceptParams
from tt_sim.cameras.camera_faults import CameraFaults
from tt_sim.cameras.tracking_cameras import TrackingCameraFaults
from tt_sim.domain_randomization import DomainRandomization
from tt_sim.world.launcher import LauncherParams
from tt_sim.world.plant import PlantParams
from tt_sim.world_file import WorldParams

FUZZ = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def every_key():
    """Names of the fields of a scenario and of its parts."""
    kinds = [Robot, WorldParams, LauncherParams, InterceptParams, PlantParams, CameraFaults, TrackingCameraFaults, DomainRandomization]
    return {f.name for kind in (Scenario, *kinds) for f in fields(kind)} | {"air", "table", "racket", "model", "position", "landing"}


KEYS = st.one_of(st.sampled_from(sorted(every_key())), st.text(max_size=5), st.integers(), st.none(), st.booleans(), st.floats())
LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from([10**400, -(10**25), 0, 1, 3]),
    st.floats(),
    st.sampled_from(["liu", "measured", "mixed", "rallies", "given", "exact", "real"]),
    st.text(max_size=8),
    st.binary(max_size=4),
    st.dates(),
)
CONTENT = st.recursive(
    LEAVES, lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(KEYS, inner, max_size=5)), max_leaves=25
)


def load_text(text, file):
    """An instance, or BadFile that names the file."""
    file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    try:
        return build(Scenario, read_yaml(file), file.name)
    except BadFile as error:
        assert error.file == file.name and error.problems and len(str(error)) < 100_000
        return None


@FUZZ
@given(content=st.dictionaries(KEYS, CONTENT, max_size=6))
@example(content={"world": {"plant": {"q_step": 10**400}}})
@example(content={"scale": [10**400, 3]})
@example(content={"goal": {"landing": [[1.0], 2.0], "flight_time": float("inf"), "spin_y": 0, "spin_z": 0}})
@example(content={"world": {"physics": {"model": ["liu"], "air": 3}}})
def test_any_mapping_is_a_scenario_or_refused(content, tmp_path):
    scenario = load_text(yaml.safe_dump(content), tmp_path / "f.yaml")
    assert scenario is None or isinstance(scenario, Scenario)


@FUZZ
@given(text=st.text(max_size=60))
@example(text="!!int ''")
@example(text="!!float ''")
@example(text="!!bool maybe: 1")
@example(text="!!timestamp soon: 1")
@example(text="!!binary é: 1")
@example(text="a: &a {<<: *a}")
@example(text="a: &a [*a]\nscale: *a")
@example(text="scale: 0b_")
@example(text="world: &w {cameras: {dropped: 0.1}, plant: *w}")
def test_any_text_is_refused_or_a_scenario(text, tmp_path):
    load_text(text, tmp_path / "f.yaml")


@FUZZ
@given(content=st.binary(max_size=60))
def test_any_bytes_are_refused_or_a_scenario(content, tmp_path):
    load_text(content, tmp_path / "f.yaml")


@pytest.mark.timeout(20)  # s; 0.7 on the day; aliases and merges hold nine of the line before each, 9^39 in all
@pytest.mark.parametrize(
    "text",
    [
        "scale: " + "[" * 20_000,
        "scale: " + "[" * 5_000 + "]" * 5_000,
        "{a: " * 20_000,
        "scale: [" + "30, " * 20_000 + "3]",
        "scale: 0x" + "f" * 50_000,
        "scale: " + "9" * 50_000,
        "\n".join(f"k{i}: 1" for i in range(9_000)),
        "a" * (MOST_YAML_BYTES + 1),
        "\n".join(
            ["a0: &a0 [x, x]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 40)]
        ),  # each holds 9 of the last
        "\n".join(["a0: &a0 {x: 1}"] + [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}" for i in range(1, 40)]),
    ],
    ids=["open", "deep", "deep mappings", "long list", "huge hexadecimal", "huge", "many keys", "long file", "aliases", "merges"],
)
def test_hostile_files_are_refused_in_bounded_time(text, tmp_path):
    scenario = load_text(text, tmp_path / "f.yaml")
    assert scenario is None


def within(kind, *left_out):
    """Mappings of the numbers of a dataclass of `param` fields, within their ranges."""
    return st.fixed_dictionaries(
        {},
        optional={
            f.name: st.floats(max(f.metadata["low"], -1e3), min(f.metadata["high"], 1e3))
            for f in fields(kind)
            if isinstance(f.default, float) and f.name not in left_out
        },
    )


VALID = st.fixed_dictionaries(
    {},
    optional={
        "kind": st.sampled_from(["top", "back", "left", "right", "mixed"]),
        "scale": st.one_of(st.integers(1, 10), st.lists(st.integers(1, 10), min_size=1, max_size=4)),
        "images": st.booleans(),
        "tick": st.floats(5e-4, 0.02),
        "launcher": st.fixed_dictionaries({}, optional={"x": st.floats(2.5, 3.0), "rate": st.one_of(st.just(0), st.integers(26, 94))}),
        "robot": st.fixed_dictionaries(
            {}, optional={"latency": st.floats(0.0, 2.0), "spin": st.just("ignored"), "physics": st.sampled_from(["liu", "measured"])}
        ),
        "world": st.fixed_dictionaries(
            {},
            optional={
                "physics": st.one_of(
                    st.just("gravity only"),
                    st.fixed_dictionaries({"model": st.just("measured")}, optional={"air": st.just({"lift": 0.2})}),
                ),
                "cameras": within(CameraFaults),
                "tracking_cameras": within(TrackingCameraFaults),
                "plant": within(PlantParams),
                "session_randomization": within(DomainRandomization),
                "domain_randomization": within(DomainRandomization),
            },
        ),
        "goal": st.just({"landing": [2.0, 0.7], "flight_time": 0.5, "spin_y": 10, "spin_z": 0}),
    },
)


def as_content(value):
    """What a file would hold."""
    if isinstance(value, dict):
        return {key: as_content(part) for key, part in value.items() if key not in ("name", "covariance", "vector") and part is not None}
    if isinstance(value, (tuple, np.ndarray)):
        return [as_content(part) for part in value]
    return float(value) if isinstance(value, np.floating) else value


@FUZZ
@given(content=VALID)
def test_a_valid_scenario_is_the_same_again_from_its_own_values(content, tmp_path):
    first = load_text(yaml.safe_dump(content), tmp_path / "f.yaml")
    assert first is not None
    values = as_content(asdict(first))
    again = load_text(yaml.safe_dump(values), tmp_path / "f.yaml")
    assert as_content(asdict(again)) == values
