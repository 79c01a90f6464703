"""Any serial arm of 5 to 8 joints becomes a model that agrees with pinocchio, and a URDF that is none is refused with its numbers."""

import numpy as np
import pinocchio as pin
import pytest
from arm.own_urdfs import ARMS, EIGHT, FIVE, GANTRY, SIX, joint, link
from tt_arm.arm_urdf.urdf import UrdfError, UrdfFailure, UrdfOptions
from tt_arm.dynamics import joint_torques
from tt_arm.joints import NO_ACCELERATION_LIMIT, NO_JERK_LIMIT
from tt_arm.model import ArmModel
from tt_core.errors import BadShape, NotFinite, OutOfRange
from tt_core.robots import read_arm

BASES = {
    "five": (-0.5, 0.76, 0.0, 0.1),
    "six": (-0.7, 0.7, 0.1, 0.0, 0.1, 0.3),
    "eight": (-0.6, 0.76, -0.1, 0.0),
    "gantry": (-0.4, 0.76, 0.1, 0.0),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("urdfs")


def model(folder, name):
    text, tip, mount, _ = ARMS[name]
    return ArmModel.from_urdf(written(folder, text), tip, BASES[name], mount)


def written(folder, text):
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def as_pinocchio_reads(text, base):
    """The same file, read by pinocchio alone; joints outside the chain are locked where the model fixes them."""
    plain = pin.buildModelFromXML(text.replace('"continuous"', '"revolute"').replace('lower="0" upper="0"', 'lower="-7" upper="7"'))
    at = pin.neutral(plain)
    locked = {"finger": 0.0, "thumb": 0.0, "cable": 0.2}
    for name, value in locked.items():
        if plain.existJointName(name):
            at[plain.joints[plain.getJointId(name)].idx_q] = value
    reduced = pin.buildReducedModel(plain, [plain.getJointId(name) for name in locked if plain.existJointName(name)], at)
    place = pin.SE3(pin.rpy.rpyToMatrix(*((0, 0, base[3]) if len(base) == 4 else base[3:])), np.array(base[:3]))
    reduced.jointPlacements[1] = place * reduced.jointPlacements[1]
    return reduced


@pytest.mark.parametrize("name", ARMS)
def test_forward_kinematics_jacobian_and_torques_are_pinocchios(folder, name):
    text, tip, mount, count = ARMS[name]
    arm, peer = model(folder, name), as_pinocchio_reads(text, BASES[name])
    assert len(arm.names) == count == peer.nq
    mounted = pin.SE3(pin.rpy.rpyToMatrix(*mount[3:]), np.array(mount[:3])) if len(mount) == 6 else None
    mounted = mounted or pin.SE3(pin.rpy.rpyToMatrix(0, mount[1], 0), np.array([0, 0, mount[0]]))
    place = peer.frames[peer.getFrameId(tip)]
    frame = peer.addFrame(pin.Frame("face", place.parentJoint, place.placement * mounted, pin.OP_FRAME))
    data, own, rng = peer.createData(), arm.pinocchio.createData(), np.random.default_rng(1)
    for _ in range(100):
        q, qdot, qddot = rng.uniform(*arm.position_limits.T), *rng.normal(0.0, 3.0, (2, count))
        jacobian = pin.computeFrameJacobian(peer, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        pin.framesForwardKinematics(peer, data, q)
        position, rotation = arm.racket(q)
        assert position == pytest.approx(data.oMf[frame].translation, abs=1e-12)
        assert rotation == pytest.approx(data.oMf[frame].rotation, abs=1e-12)
        assert arm.jacobian(q) == pytest.approx(jacobian, abs=1e-12)
        torque = np.empty(count)
        joint_torques(q, qdot, qddot, arm.chain, arm.links, torque, np.empty((count, 6)))
        assert torque == pytest.approx(pin.rnea(arm.pinocchio, own, q, qdot, qddot), abs=1e-9)
    masses = sum(inertia.mass for inertia in peer.inertias)
    assert sum(inertia.mass for inertia in arm.pinocchio.inertias) == pytest.approx(masses + 0.18)  # kg, the racket's


@pytest.mark.parametrize("name", ARMS)
def test_the_jacobian_is_the_derivative(folder, name):
    arm, h, rng = model(folder, name), 1e-6, np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(*arm.position_limits.T)
        jacobian = arm.jacobian(q)
        for i in range(len(q)):
            step = h * np.eye(len(q))[i]
            (p1, r1), (p0, r0) = arm.racket(q + step), arm.racket(q - step)
            turn = (r1 - r0) @ arm.racket(q)[1].T / (2 * h)
            # central differences: h^2 and rounding 1e-16/h, both below 1e-9
            assert (p1 - p0) / (2 * h) == pytest.approx(jacobian[:3, i], abs=1e-8)
            assert [turn[2, 1], turn[0, 2], turn[1, 0]] == pytest.approx(jacobian[3:, i], abs=1e-8)


def test_the_pa10_is_one_of_them():
    given, urdf = read_arm("pa10")
    one, other = ArmModel.pa10(), ArmModel.from_urdf(urdf, "racket", given.base)
    q = one.waiting
    assert np.array(one.racket(q)[1]) == pytest.approx(other.racket(q)[1], abs=1e-9)
    assert one.racket(q)[0] == pytest.approx(other.racket(q)[0], abs=1e-9)
    mounted = ArmModel.from_urdf(urdf, given.tip, given.base, given.mount)
    assert mounted.racket(q)[0] == pytest.approx(one.racket(q)[0], abs=1e-12)
    assert mounted.bodies.rim == one.bodies.rim


def test_limits_come_from_the_urdf_and_the_options(folder):
    arm = model(folder, "six")
    assert arm.names == ("a1", "a2", "a3", "a4", "a5", "a6")
    assert arm.limits.units == ("rad",) * 6
    assert arm.position_limits[0] == pytest.approx([-2 * np.pi, 2 * np.pi])  # a continuous joint
    assert arm.speed_limits == pytest.approx([4, 4, 5, 7, 7, 7])
    assert arm.limits.acceleration == pytest.approx(NO_ACCELERATION_LIMIT) and arm.limits.jerk == pytest.approx(NO_JERK_LIMIT)
    options = UrdfOptions(limits={"a2": {"velocity": 1.5, "acceleration": 12.0, "jerk": 800.0, "lower": -1.0}})
    arm = ArmModel.from_urdf(written(folder, SIX), "tool0", options=options)
    assert arm.position_limits[1] == pytest.approx([-1.0, 2.2])
    assert (arm.speed_limits[1], arm.limits.acceleration[1], arm.limits.jerk[1]) == (1.5, 12.0, 800.0)
    stated = SIX.replace('upper="2.2" velocity="4"', 'upper="2.2" velocity="4" acceleration="9" jerk="500"')
    arm = ArmModel.from_urdf(written(folder, stated), "tool0")
    assert (arm.limits.acceleration[1], arm.limits.jerk[1]) == (9.0, 500.0)
    assert ArmModel.from_urdf(written(folder, EIGHT), "flange").limits.units == ("m", "m", *["rad"] * 6)


def test_joints_are_fixed_and_links_left_out_by_name(folder):
    path = written(folder, EIGHT)
    moved = ArmModel.from_urdf(path, "flange", options=UrdfOptions(fixed={"x": 0.25}))
    whole = ArmModel.from_urdf(path, "flange")
    q = np.full(7, 0.3)
    assert moved.names == whole.names[1:]
    assert moved.racket(q)[0] == pytest.approx(whole.racket(np.append(0.25, q))[0], abs=1e-12)
    turned = ArmModel.from_urdf(path, "flange", options=UrdfOptions(fixed={"j4": -0.7}))
    assert turned.racket(q)[0] == pytest.approx(whole.racket(np.insert(q, 5, -0.7))[0], abs=1e-12)
    path = written(folder, GANTRY)
    lighter = ArmModel.from_urdf(path, "tip", options=UrdfOptions(left_out=("chain",)))
    masses = [sum(i.mass for i in arm.pinocchio.inertias) for arm in (ArmModel.from_urdf(path, "tip"), lighter)]
    assert masses[0] - masses[1] == pytest.approx(0.3)  # kg, of the cable chain
    assert len(lighter.bodies.radii) == len(ArmModel.from_urdf(path, "tip").bodies.radii) - 1


def test_a_usual_racket_is_added_where_there_is_none(folder):
    arm = model(folder, "five")
    assert arm.bodies.rim == pytest.approx(0.08)  # m, blade 0.075 and 0.005 allowed
    assert arm.pinocchio.existFrame("racket")


def refused(folder, text, tip="hand", **given):
    with pytest.raises(UrdfError) as error:
        ArmModel.from_urdf(written(folder, text), tip, **given)
    assert str(error.value)
    return error.value.failure.code, error.value.failure.values


LIMIT = (-1.0, 1.0, 2, 10)
L2 = '<cylinder radius="0.04" length="0.4"/>'  # the shape of the link l2
BENT = FIVE.replace('<joint name="elbow" type="revolute">', '<joint name="elbow" type="{kind}">')


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("<robot name='a'><link", UrdfFailure.NOT_READABLE, {}),
        ("", UrdfFailure.NOT_READABLE, {}),
        ("<sdf/>", UrdfFailure.NOT_A_URDF, {"tag": "sdf"}),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="x"/></robot>', UrdfFailure.NOT_A_URDF, {}),
        ("<robot name='a'/>", UrdfFailure.SEVERAL_ROOTS, {"count": 0}),
        (FIVE.replace("</robot>", link("hand") + "</robot>"), UrdfFailure.DUPLICATE, {"count": 2, "name": "hand"}),
        (FIVE.replace("</robot>", link("lonely") + "</robot>"), UrdfFailure.SEVERAL_ROOTS, {"count": 2}),
        (FIVE.replace('<child link="l3"/>', '<child link="nowhere"/>'), UrdfFailure.UNKNOWN_LINK, {"link": "nowhere"}),
        (FIVE.replace("</robot>", joint("loop", "fixed", "hand", "l2") + "</robot>"), UrdfFailure.CLOSED_CHAIN, {"link": "l2"}),
        (FIVE.replace('<parent link="base"/>', '<parent link="hand"/>'), UrdfFailure.CLOSED_CHAIN, {}),
        (BENT.format(kind="planar"), UrdfFailure.WRONG_TYPE, {"joint": "elbow", "kind": "planar"}),
        (BENT.format(kind="floating"), UrdfFailure.WRONG_TYPE, {"joint": "elbow", "kind": "floating"}),
        (BENT.format(kind="spherical"), UrdfFailure.WRONG_TYPE, {"joint": "elbow", "kind": "spherical"}),
        (BENT.format(kind="fixed"), UrdfFailure.WRONG_COUNT, {"count": 4, "least": 5, "most": 8}),
        (FIVE.replace('axis xyz="1 0 0"', 'axis xyz="0 0 0"'), UrdfFailure.ZERO_AXIS, {"joint": "flip"}),
        (FIVE.replace('axis xyz="1 0 0"', 'axis xyz="1 0"'), UrdfFailure.BAD_NUMBER, {"count": 3}),
        (FIVE.replace('xyz="0 0 0.4"', 'xyz="0 0 nan"'), UrdfFailure.BAD_NUMBER, {"text": "0 0 nan"}),
        (FIVE.replace('upper="2.4"', 'upper="inf"'), UrdfFailure.BAD_NUMBER, {"text": "inf"}),
        (FIVE.replace('upper="2.4"', 'upper="-2.4"'), UrdfFailure.WRONG_LIMITS, {"joint": "elbow", "low": -2.4, "high": -2.4}),
        (FIVE.replace('velocity="5"', 'velocity="0"'), UrdfFailure.WRONG_LIMITS, {"joint": "elbow", "speed": 0.0}),
        (FIVE.replace('effort="100"', ""), UrdfFailure.NO_LIMITS, {"joint": "elbow", "missing": "effort"}),
        (FIVE.replace('<limit lower="-2.4" upper="2.4" velocity="5" effort="100"/>', ""), UrdfFailure.NO_LIMITS, {"joint": "elbow"}),
        (FIVE.replace('velocity="5"', 'velocity="5" jerk="-1"'), UrdfFailure.WRONG_LIMIT, {"attribute": "jerk", "value": -1.0}),
        (FIVE.replace('"1 0 0"/>', '"1 0 0"/><mimic joint="elbow"/>'), UrdfFailure.MIMIC, {"joint": "flip", "other": "elbow"}),
        (FIVE.replace('mass value="2.0"', 'mass value="-2.0"'), UrdfFailure.WRONG_MASS, {"link": "l2", "mass": -2.0}),
        (FIVE.replace('radius="0.04"', 'radius="-0.04"'), UrdfFailure.WRONG_SIZE, {"link": "l2", "value": -0.04}),
        (FIVE.replace(L2, "<cone/>"), UrdfFailure.NO_SHAPE, {"link": "l2"}),
        (FIVE.replace(L2, '<mesh filename="package://none/a.stl"/>'), UrdfFailure.NO_MESH, {"link": "l2"}),
    ],
    ids=lambda value: value.name if isinstance(value, UrdfFailure) else "",
)  # fmt: skip
def test_a_bad_urdf_is_refused_with_its_numbers(folder, text, code, values):
    found, numbers = refused(folder, text)
    assert found is code
    assert values.items() <= numbers.items()


def test_a_bad_choice_is_refused_with_its_numbers(folder):
    code, values = refused(folder, FIVE, "tool9")
    assert (code, values["tip"], values["links"]) == (UrdfFailure.UNKNOWN_TIP, "tool9", ["hand"])
    code, values = refused(folder, SIX, None)
    assert (code, values["count"]) == (UrdfFailure.SEVERAL_TIPS, 2)
    code, values = refused(folder, SIX, "thumb")
    assert (code, values["joint"], values["other"]) == (UrdfFailure.MIMIC, "thumb", "finger")
    nine = EIGHT.replace("</robot>", joint("j7", "revolute", "flange", "end", axis="1 0 0", limit=LIMIT) + link("end") + "</robot>")
    code, values = refused(folder, nine, "end")
    assert (code, values["count"]) == (UrdfFailure.WRONG_COUNT, 9)
    assert refused(folder, FIVE, options=UrdfOptions(fixed={"knee": 0.0}))[0] is UrdfFailure.UNKNOWN_JOINT
    assert refused(folder, FIVE, options=UrdfOptions(limits={"elbow": {"speed": 1.0}}))[0] is UrdfFailure.WRONG_LIMIT
    assert refused(folder, FIVE, options=UrdfOptions(limits={"elbow": {"velocity": np.nan}}))[0] is UrdfFailure.BAD_NUMBER
    assert refused(folder, FIVE, options=UrdfOptions(left_out=("l3",)))[0] is UrdfFailure.ON_THE_CHAIN
    assert refused(folder, FIVE, options=UrdfOptions(left_out=("l9",)))[0] is UrdfFailure.UNKNOWN_LINK
    with pytest.raises(UrdfError) as error:
        ArmModel.from_urdf(folder / "nothing.urdf", "hand")
    assert error.value.failure.code is UrdfFailure.NOT_READABLE
    path = written(folder, FIVE)
    with pytest.raises(BadShape):
        ArmModel.from_urdf(path, "hand", waiting=[0.0] * 7)
    with pytest.raises(BadShape):
        ArmModel.from_urdf(path, "hand", base=(0.0, 0.0))
    with pytest.raises(NotFinite):
        ArmModel.from_urdf(path, "hand", mount=(np.nan, 0.0))
    with pytest.raises(OutOfRange):
        ArmModel.from_urdf(path, "hand", waiting=[0.0, 3.0, 0.0, 0.0, 0.0])
    with pytest.raises(BadShape):
        ArmModel.from_urdf(path, "hand").racket(np.zeros(7))
