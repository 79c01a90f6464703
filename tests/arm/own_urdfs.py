"""Small arms as URDF texts: five to eight joints of all kinds and axes, with offsets, a gripper, branches and fixed joints."""

CYLINDER = '<collision><origin xyz="0 0 {half}"/><geometry><cylinder radius="{radius}" length="{length}"/></geometry></collision>'
INERTIAL = (
    '<inertial><origin xyz="0.01 -0.005 {half}" rpy="0.1 0 0.2"/><mass value="{mass}"/>'
    '<inertia ixx="0.012" ixy="0.001" ixz="-0.0005" iyy="0.010" iyz="0.0002" izz="0.004"/></inertial>'
)


def link(name, length=0.0, radius=0.03, mass=1.0, more=""):
    """A link with a cylinder of `length` along z, or without a body."""
    body = CYLINDER.format(half=length / 2, length=length, radius=radius) if length else ""
    return f'<link name="{name}">{INERTIAL.format(half=length / 2, mass=mass) if mass else ""}{body}{more}</link>'


def joint(name, kind, parent, child, **given):
    """A joint; given: xyz, rpy, axis, and limits as `limit` (lower, upper, velocity, effort)."""
    parts = [f'<origin xyz="{given.get("xyz", "0 0 0")}" rpy="{given.get("rpy", "0 0 0")}"/>']
    parts += [f'<parent link="{parent}"/>', f'<child link="{child}"/>']
    parts += [f'<axis xyz="{given["axis"]}"/>'] if "axis" in given else []
    if "limit" in given:
        low, high, speed, effort = given["limit"]
        parts.append(f'<limit lower="{low}" upper="{high}" velocity="{speed}" effort="{effort}"/>')
    return f'<joint name="{name}" type="{kind}">{"".join(parts)}{given.get("more", "")}</joint>'


def robot(*parts):
    """A URDF."""
    return f'<?xml version="1.0"?><robot name="own">{"".join(parts)}</robot>'


FIVE = robot(
    link("base", 0.3, 0.08, 5.0),
    joint("yaw", "revolute", "base", "l1", xyz="0 0 0.3", axis="0 0 1", limit=(-2.6, 2.6, 4, 150)),
    link("l1", 0.1, 0.06),
    joint("shoulder", "revolute", "l1", "l2", xyz="0.05 0 0.1", axis="0 1 0", limit=(-1.9, 1.9, 4, 150)),
    link("l2", 0.4, 0.04, 2.0),
    joint("elbow", "revolute", "l2", "l3", xyz="0 0 0.4", axis="0 1 0", limit=(-2.4, 2.4, 5, 100)),
    link("l3", 0.3, 0.035),
    joint("plate", "fixed", "l3", "l3b", xyz="0 0 0.3", rpy="0 0 0.3"),
    link("l3b", 0.0, mass=0.2),
    joint("roll", "revolute", "l3b", "l4", axis="0 0 1", limit=(-3.5, 3.5, 8, 40)),
    link("l4", 0.08, 0.03, 0.5),
    joint("flip", "revolute", "l4", "hand", xyz="0 0 0.08", axis="1 0 0", limit=(-2.0, 2.0, 8, 40)),
    link("hand", 0.05, 0.025, 0.3),
)

SIX = robot(  # skew and unnormalised axes, continuous joints, a gripper with a mimic joint
    link("world", mass=0),
    joint("stand", "fixed", "world", "base", xyz="0 0 0.1"),
    link("base", 0.2, 0.09, 6.0),
    joint("a1", "continuous", "base", "l1", xyz="0 0 0.2", axis="0 0 2", limit=(0, 0, 4, 300)),
    link("l1", 0.15, 0.06, 3.0),
    joint("a2", "revolute", "l1", "l2", xyz="0 0.12 0.15", axis="0.1 1 0", limit=(-2.2, 2.2, 4, 300)),
    link("l2", 0.42, 0.05, 4.0),
    joint("a3", "revolute", "l2", "l3", xyz="0 -0.1 0.42", axis="0 -1 0.05", limit=(-2.7, 2.7, 5, 150)),
    link("l3", 0.38, 0.04, 2.0),
    joint("a4", "continuous", "l3", "l4", xyz="0 0 0.38", rpy="0 0.2 0", axis="0 1 0", limit=(0, 0, 7, 60)),
    link("l4", 0.09, 0.035, 0.8),
    joint("a5", "revolute", "l4", "l5", xyz="0 0.08 0.09", rpy="1.2 0 0", axis="0 0.3 1", limit=(-6.2, 6.2, 7, 60)),
    link("l5", 0.09, 0.035, 0.8),
    joint("a6", "revolute", "l5", "tool0", xyz="0.02 0 0.09", axis="0 1 0.1", limit=(-6.2, 6.2, 7, 60)),
    link("tool0", mass=0.1),
    joint("palm", "fixed", "tool0", "palm", xyz="0 0.03 0"),
    link("palm", 0.04, 0.03, 0.4),
    joint("finger", "prismatic", "palm", "finger", xyz="0.02 0 0.04", axis="1 0 0", limit=(0.0, 0.03, 0.1, 20)),
    link("finger", 0.05, 0.008, 0.05),
    joint("thumb", "prismatic", "palm", "thumb", xyz="-0.02 0 0.04", axis="-1 0 0", limit=(0.0, 0.03, 0.1, 20),
          more='<mimic joint="finger" multiplier="1"/>'),
    link("thumb", 0.05, 0.008, 0.05),
)  # fmt: skip

EIGHT = robot(  # two linear axes below a six-joint arm
    link("frame", 0.1, 0.05, 20.0),
    joint("x", "prismatic", "frame", "beam", xyz="0 0 0.2", axis="1 0 0", limit=(-0.4, 0.4, 2.5, 900)),
    link("beam", 0.1, 0.05, 8.0),
    joint("y", "prismatic", "beam", "carriage", xyz="0 0 0.2", axis="0 1 0", limit=(-0.7, 0.7, 3.0, 700)),
    link("carriage", 0.1, 0.06, 4.0),
    joint("j1", "revolute", "carriage", "l1", xyz="0 0 0.1", axis="0 0 1", limit=(-3.0, 3.0, 5, 200)),
    link("l1", 0.1, 0.05, 2.0),
    joint("j2", "revolute", "l1", "l2", xyz="0 0 0.1", axis="0 1 0", limit=(-1.8, 1.8, 5, 200)),
    link("l2", 0.3, 0.04, 2.0),
    joint("j3", "revolute", "l2", "l3", xyz="0.03 0 0.3", axis="0 1 0", limit=(-2.5, 2.5, 6, 100)),
    link("l3", 0.25, 0.035, 1.5),
    joint("j4", "revolute", "l3", "l4", xyz="0 0 0.25", axis="0 0 1", limit=(-3.1, 3.1, 9, 40)),
    link("l4", 0.06, 0.03, 0.5),
    joint("j5", "revolute", "l4", "l5", xyz="0 0 0.06", axis="0 1 0", limit=(-2.0, 2.0, 9, 40)),
    link("l5", 0.06, 0.03, 0.5),
    joint("j6", "revolute", "l5", "flange", xyz="0 0 0.06", axis="0 0 1", limit=(-3.1, 3.1, 9, 40)),
    link("flange", mass=0.2),
)

GANTRY = robot(  # five joints, two of them linear, and a second branch with a joint of its own
    link("posts", 0.2, 0.05, 20.0),
    joint("rail", "prismatic", "posts", "sledge", xyz="0 0 0.2", axis="0 1 0", limit=(-0.7, 0.7, 4.0, 500)),
    link("sledge", 0.1, 0.05, 3.0),
    joint("lift", "prismatic", "sledge", "slide", xyz="0.05 0 0", axis="0 0 1", limit=(0.0, 0.5, 3.0, 500)),
    link("slide", 0.3, 0.04, 2.0),
    joint("cable", "revolute", "slide", "chain", xyz="-0.1 0 0", axis="0 1 0", limit=(0.2, 1.0, 1, 1)),
    link("chain", 0.1, 0.01, 0.3),
    joint("swing", "revolute", "slide", "arm", axis="0 0 -1", limit=(-2.0, 2.0, 9, 80)),
    link("arm", 0.1, 0.03, 1.0),
    joint("pitch", "revolute", "arm", "fore", xyz="0.1 0 0", axis="0 1 0", limit=(-2.0, 2.0, 9, 80)),
    link("fore", 0.25, 0.025, 0.6),
    joint("twist", "revolute", "fore", "tip", xyz="0 0 0.25", axis="0 0 1", limit=(-3.0, 3.0, 15, 20)),
    link("tip", mass=0.1),
)

ARMS = {  # text, tip, mount, joints
    "five": (FIVE, "hand", (0.0, 0.0, 0.15, 0.0, 0.0, 0.0), 5),
    "six": (SIX, "tool0", (0.0, 0.25, 0.0, 1.2, 0.3, 0.0), 6),
    "eight": (EIGHT, "flange", (0.15, 1.5707963267948966), 8),
    "gantry": (GANTRY, "tip", (0.1, 1.5707963267948966), 5),
}
