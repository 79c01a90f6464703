"""The bodies of an arm are bounded by capsules, and their distances are coal's."""

import struct
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
from arm.own_urdfs import ARMS, FIVE
from tt_arm.arm_urdf.bodies import around_box, around_cylinder, around_mesh, around_points, capsules
from tt_arm.arm_urdf.meshes import MeshNotFound, resolve, triangles
from tt_arm.arm_urdf.urdf import UrdfError, UrdfFailure, UrdfOptions, read_urdf
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import (
    between_segments,
    bodies_from_each_other,
    bodies_from_floor,
    bodies_from_table,
    clearances,
    segment_from_table,
)
from tt_core.constants import FLOOR_Z, TABLE_LENGTH, TABLE_THICKNESS, TABLE_WIDTH

SLACK = 1e-9  # m, rounding
SIZE = np.array([TABLE_LENGTH, TABLE_WIDTH, TABLE_THICKNESS])
TABLE = coal.Box(*SIZE), coal.Transform3s(np.eye(3), 0.5 * SIZE * [1.0, 1.0, -1.0])


def inside(capsule, points):
    """Whether points (n, 3) are in a capsule."""
    way = capsule.end - capsule.start
    along = np.clip((points - capsule.start) @ way / max(way @ way, 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - capsule.start - along[:, None] * way, axis=1) <= capsule.radius + SLACK


def as_coal(start, end, radius):
    """A capsule of coal, with its place."""
    way = end - start
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way if way.any() else np.array([0.0, 0.0, 1.0])).matrix()
    return coal.Capsule(radius, float(np.linalg.norm(way))), coal.Transform3s(turn, 0.5 * (start + end))


def distance(one, other):
    return coal.distance(*one, *other, coal.DistanceRequest(), coal.DistanceResult())


def test_segments_are_as_far_apart_as_coal_says():
    rng = np.random.default_rng(0)
    for _ in range(2000):
        starts, ends = rng.uniform([-1, -1, -0.6], [3.5, 2.5, 0.8], (2, 2, 3))
        starts[1] += rng.uniform(0.0, 1.0) * (starts[0] - starts[1])  # some near each other
        tiny = 1e-4  # m, radii that coal subtracts
        apart = distance(as_coal(starts[0], ends[0], tiny), as_coal(starts[1], ends[1], tiny))
        assert between_segments(starts, ends, 0, 1) == pytest.approx(max(0.0, apart + 2 * tiny), abs=1e-6) or apart <= 0.0
        apart = distance(as_coal(starts[0], ends[0], tiny), TABLE)
        if apart > 0.0:
            assert segment_from_table(starts, ends, 0) == pytest.approx(apart + tiny, abs=1e-6)
        else:
            assert segment_from_table(starts, ends, 0) <= tiny + 1e-6


@pytest.mark.parametrize("name", ARMS)
def test_the_clearance_of_an_arm_is_coals(tmp_path, name):
    """Of all its capsules; the racket's disc is looked at by points of its rim, which coal has no shape for."""
    text, tip, mount, _ = ARMS[name]
    (tmp_path / "arm.urdf").write_text(text)
    arm = ArmModel.from_urdf(tmp_path / "arm.urdf", tip, (-0.3, 0.76, 0.0, 0.2), mount)
    bodies, rng = arm.bodies, np.random.default_rng(1)
    floor = coal.Halfspace(np.array([0.0, 0.0, 1.0]), FLOOR_Z), coal.Transform3s()
    data, own = arm.pinocchio.createData(), capsules(arm.description)
    frames = [(arm.pinocchio.getFrameId(link, pin.FrameType.BODY), parts) for link, parts in own.items() if link != "racket"]
    for _ in range(50):
        q = rng.uniform(*arm.position_limits.T)
        pin.framesForwardKinematics(arm.pinocchio, data, q)
        places = [  # by pinocchio, link by link
            (arm.pinocchio.frames[frame].parentJoint, capsule.moved(data.oMf[frame])) for frame, parts in frames for capsule in parts
        ]
        moving = [capsule for joint, capsule in places if joint > 1]  # what the first joint turns about itself stands still
        tables = [distance(as_coal(*capsule), TABLE) for capsule in moving]
        floors = [distance(as_coal(*capsule), floor) for capsule in moving]
        table, ground, _ = clearances(q, bodies)
        if min(tables) > 0.0:
            assert table <= min(tables) + 1e-6
        assert ground <= min(floors) + 1e-6
        starts = np.array([capsule.start for _, capsule in places])
        ends = np.array([capsule.end for _, capsule in places])
        radii = np.array([capsule.radius for _, capsule in places])
        reaches = radii + 0.5 * np.linalg.norm(ends - starts, axis=1)
        first = sum(joint <= 1 for joint, _ in places)
        if min(tables) > 0.0:
            assert bodies_from_table(starts, ends, radii, reaches, first, 9.0) == pytest.approx(min(tables), abs=1e-6)
        assert bodies_from_floor(starts, ends, radii, first, 9.0) == pytest.approx(min(floors), abs=1e-6)
        pairs = np.array([(i, k) for k in range(len(places)) for i in range(k)])
        apart = min(distance(as_coal(*places[i][1]), as_coal(*places[k][1])) for i, k in pairs)
        found = bodies_from_each_other(starts, ends, radii, reaches, pairs, 9.0)
        assert found == pytest.approx(apart, abs=1e-6) or (found <= 0.0 and apart <= 1e-6)


def test_a_cylinder_is_within_its_capsule():
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    for radius, length in ((0.1, 1.0), (0.1, 0.1), (0.1, 0.001), (0.01, 2.0)):
        rims = [np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(60, z)]) for z in (-length / 2, length / 2)]
        assert inside(around_cylinder(radius, length), np.vstack(rims)).all()


@pytest.mark.parametrize("size", [(0.1, 0.1, 0.1), (1.0, 0.2, 0.1), (0.6, 0.5, 0.02), (0.02, 2.0, 0.3)])
def test_a_box_is_within_its_capsules(size):
    size, rng = np.array(size), np.random.default_rng(0)
    corners = 0.5 * size * np.array(list(product((-1, 1), repeat=3)))
    points = np.vstack([corners, rng.uniform(-0.5, 0.5, (2000, 3)) * size])
    assert np.any([inside(capsule, points) for capsule in around_box(size)], axis=0).all()


def bent_pipe():
    """Triangles of an L: two long boxes."""
    vertices, corners = [], []
    for low, high in (((0, 0, 0), (0.1, 0.1, 0.6)), ((0, 0, 0.5), (0.7, 0.1, 0.6))):
        steps = np.linspace(0.0, 1.0, 13)
        for axis in range(3):
            for side in (low, high):
                u, v = [k for k in range(3) if k != axis]
                points = np.empty((13 * 13, 3))
                points[:, axis], points[:, u], points[:, v] = side[axis], np.repeat(steps, 13), np.tile(steps, 13)
                points[:, u], points[:, v] = (low[k] + points[:, k] * (high[k] - low[k]) for k in (u, v))
                first = sum(map(len, vertices))
                vertices.append(points)
                for k in (first + 13 * i + j for i in range(12) for j in range(12)):
                    corners += [(k, k + 1, k + 13), (k + 14, k + 1, k + 13)]
    return np.vstack(vertices), np.array(corners)


def test_a_mesh_is_within_its_capsules():
    vertices, corners = bent_pipe()
    found = around_mesh(vertices, corners)
    middles = vertices[corners].mean(axis=1)
    assert np.any([inside(capsule, np.vstack([vertices, middles])) for capsule in found], axis=0).all()
    assert len(found) > 1 and sum(c.volume for c in found) < 0.7 * around_points(vertices).volume


def stl(path, vertices, corners):
    """Write a binary STL."""
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[corner].ravel(), 0) for corner in corners)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + body)


def test_meshes_are_found_beside_the_file_and_bounded(tmp_path):
    vertices, corners = bent_pipe()
    stl(tmp_path / "own_description" / "meshes" / "l2.stl", 100.0 * vertices, corners)
    folder = tmp_path / "own_description" / "urdf"
    folder.mkdir()
    text = FIVE.replace('<cylinder radius="0.04" length="0.4"/>', '<mesh filename="{}" scale="0.01 0.01 0.01"/>')
    for name in ("package://own_description/meshes/l2.stl", "../meshes/l2.stl", f"file://{tmp_path}/own_description/meshes/l2.stl"):
        (folder / "arm.urdf").write_text(text.format(name))
        arm = ArmModel.from_urdf(folder / "arm.urdf", "hand")
        parts = capsules(arm.description)["l2"]
        assert np.any([inside(capsule, vertices + [0.0, 0.0, 0.2]) for capsule in parts], axis=0).all()  # float32 of the file: below SLACK
    for name in ("package://tt_arm/urdf/pa10.urdf", "package://tt_arm/nothing.stl"):
        (folder / "arm.urdf").write_text(text.format(name))
        with pytest.raises(UrdfError) as error:
            ArmModel.from_urdf(folder / "arm.urdf", "hand")
        assert error.value.failure.code in (UrdfFailure.BAD_MESH, UrdfFailure.NO_MESH)
    with pytest.raises(MeshNotFound) as error:
        resolve("package://none/a.stl", folder / "arm.urdf")
    assert error.value.places
    found, _ = triangles(tmp_path / "own_description" / "meshes" / "l2.stl", np.full(3, 0.01))
    assert found.max(axis=0) == pytest.approx(vertices.max(axis=0), abs=1e-6)


def test_every_shape_is_read(tmp_path):
    round_ones = 'sphere radius="0.1"', 'capsule radius="0.1" length="0.3"', 'cylinder radius="0.1" length="0.3"'
    for shape in ('<box size="0.1 0.2 0.3"/>', *(f"<{one}/>" for one in round_ones)):
        (tmp_path / "arm.urdf").write_text(FIVE.replace('<cylinder radius="0.04" length="0.4"/>', shape))
        description = read_urdf(str(tmp_path / "arm.urdf"), "hand", None, UrdfOptions())
        assert capsules(description)["l2"]
