"""Messages of every type become text and come back; definitions name the types that messages are made of."""

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseWithCovariance
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from rosidl_parser.definition import AbstractNestedType, NamespacedType
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory
from tt_tools import packages
from tt_tools.errors import GraphError
from tt_tools.interface_text import definition, nested_type
from tt_tools.listen import bandwidth, message_part, statistics
from tt_tools.message_text import FieldError, TextOptions, message_from_values, to_csv, to_plain, to_yaml, values_of
from tt_tools.node_parameters import parameter_file_text

MESSAGES = packages.interfaces("msg")


def filled(kind, depth=0):
    """A message with something in each of its fields, as YAML can write it."""
    message, values = packages.interface(kind)(), {}
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        value = getattr(message, name)
        element = slot.value_type if isinstance(slot, AbstractNestedType) else slot
        if isinstance(element, NamespacedType):
            one = filled("/".join(element.namespaced_name()), depth + 1)
            values[name] = [one] * max(1, len(value)) if isinstance(slot, AbstractNestedType) else one
        elif isinstance(slot, AbstractNestedType) and len(value):  # an array of fixed size
            values[name] = np.arange(len(value)).tolist()
        elif isinstance(value, str):
            values[name] = "ä: [1]"
        elif isinstance(value, bool):
            values[name] = True
        elif isinstance(value, (int, float)):
            values[name] = type(value)(7)
    return values


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_message_takes_the_values_that_it_gives(kind):
    message = message_from_values(packages.interface(kind), filled(kind))
    assert message == message_from_values(packages.interface(kind), yaml.safe_load(to_yaml(message)))
    assert to_plain(message) == yaml.safe_load(to_yaml(message, TextOptions(flow=True)))


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_definition_names_the_types_of_a_message(kind):
    lines = [line for line in definition(kind) if not line.startswith("\t")]
    found = {name for line in lines if (name := nested_type(line, kind.split("/")[0]))}
    slots = [slot.value_type if isinstance(slot, AbstractNestedType) else slot for slot in packages.interface(kind).SLOT_TYPES]
    assert found == {"/".join(slot.namespaced_name()) for slot in slots if isinstance(slot, NamespacedType)}


def test_services_and_comments_are_shown():
    assert list(definition("std_srvs/srv/SetBool", comments=False)) == ["bool data", "---", "bool success", "string message"]
    assert "\tbuiltin_interfaces/Time stamp" in definition("sensor_msgs/msg/Image")
    assert not any("#" in line for line in definition("sensor_msgs/msg/Image", comments=False))


def test_long_and_numerous_things_are_cut():
    image = Image(data=list(range(200)), encoding="e" * 200)
    plain = to_plain(image, TextOptions(truncate=3))
    assert plain["data"] == [0, 1, 2, "..."] and plain["encoding"] == "eee..."
    short = to_plain(image, TextOptions(arrays=False, strings=False))
    assert short["data"] == "<sequence type: uint8, length: 200>" and short["encoding"] == "<string length: <200>>"
    assert to_plain(PoseWithCovariance(), TextOptions(arrays=False))["covariance"] == "<array type: double[36]>"
    assert to_csv(JointState(name=["a", "b"], position=[1.0, 2.0])) == "0,0,,a,b,1.0,2.0"


def test_words_stand_for_the_time():
    now = Header().stamp.__class__(sec=5)
    for values in ("{header: auto, joint_names: [a]}", "{header: {stamp: now}}"):
        assert message_from_values(JointTrajectory, values_of(values), now).header.stamp.sec == 5
    with pytest.raises(FieldError):
        message_from_values(JointTrajectory, values_of("{header: auto}"))


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ("{type: x}", "type"),
        ("{nothing: 1}", "nothing"),
        ("{type: 999}", "type"),
        ("{double_array_value: 1.0}", "double_array_value"),
        ("{bool_value: 3}", "bool_value"),
    ],
)
def test_a_value_of_another_type_is_refused_with_its_field(values, field):
    with pytest.raises(FieldError) as caught:
        message_from_values(ParameterValue, values_of(values))
    assert caught.value.field == field


@pytest.mark.parametrize("text", ["[1]", "3", "{a: [}", "x"])
def test_what_is_no_mapping_is_refused(text):
    with pytest.raises(FieldError):
        values_of(text)


def test_a_part_of_a_message_is_named_by_its_path():
    message = message_from_values(JointTrajectory, values_of("{points: [{positions: [1, 2]}, {time_from_start: {sec: 4}}]}"))
    assert message_part(message, "points[0].positions[1]") == 2.0 and message_part(message, "points[1].time_from_start.sec") == 4
    assert message_part(message, "") is message
    for wrong in ("point", "points[9]", "points[a]", "points[0].speed", "points..x"):
        with pytest.raises(GraphError):
            message_part(message, wrong)


def test_figures_of_a_topic():
    assert statistics([1.0, 3.0]) == (2.0, 1.0, 3.0, 1.0)
    assert bandwidth([(0.0, 100), (1.0, 300)], 2.0) == "200 B/s from 2 messages\n\tMessage size mean: 200 B min: 100 B max: 300 B"
    assert bandwidth([(0.0, 2e6), (1.0, 2e6)], 2.0).startswith("2.00 MB/s from 2 messages\n")


def test_parameters_become_a_file_that_ros_reads(tmp_path):
    values = {"right": "/dev/video1", "right.matrix": [1.0, 2.0], "swing.limit.speed": 3.0, "swing.profile": "auto", "n": 4, "empty": []}
    messages = [Parameter(name, value=value).get_parameter_value() for name, value in values.items()]
    (tmp_path / "file.yaml").write_text(parameter_file_text("/camera", list(values), messages))
    found = parameter_dict_from_yaml_file(str(tmp_path / "file.yaml"), target_nodes=["/camera"])
    for name, value in values.items():
        assert name == "empty" or np.array_equal(parameter_value_to_python(found[name].value), value), name
