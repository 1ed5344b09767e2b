"""A small arm for tests, as URDF and as MJCF: three turning joints, inertias of no symmetry, one armature."""

import numpy as np

LINKS = (  # axis, place of the joint in its parent, mass, centre of mass
    ((0, 0, 1), (0.0, 0.0, 0.2), 4.0, (0.02, -0.01, 0.1)),
    ((0, 1, 0), (0.1, 0.05, 0.2), 3.0, (0.2, 0.01, 0.03)),
    ((0, 1, 0), (0.45, 0.0, 0.02), 2.0, (0.15, -0.02, 0.01)),
)
INERTIA = (0.03, 0.002, 0.04, 0.001, -0.003, 0.02)  # xx, xy, yy, xz, yz, zz of each link, about its centre of mass
ARMATURE = 0.3  # of the second joint, in the MJCF alone: a URDF has no place for it


def text(values):
    return " ".join(f"{x:g}" for x in values)


def urdf(folder, kind="revolute"):
    """Path of the arm as URDF; with a gripper's finger that slides at its end."""
    xx, xy, yy, xz, yz, zz = INERTIA
    inertia = f'<inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>'
    limit = '<limit effort="80" velocity="3" lower="-3" upper="3"/>'
    parts = ['<robot name="arm"><link name="base"/>']
    for k, (axis, place, mass, centre) in enumerate(LINKS, 1):
        parts += [
            f'<link name="link_{k}"><inertial><origin xyz="{text(centre)}"/><mass value="{mass}"/>{inertia}'
            "</inertial></link>",
            f'<joint name="j{k}" type="{kind}"><parent link="{"base" if k == 1 else f"link_{k - 1}"}"/>'
            f'<child link="link_{k}"/><origin xyz="{text(place)}"/><axis xyz="{text(axis)}"/>{limit}'
            '<dynamics damping="5" friction="3"/></joint>',
        ]
    parts += [
        '<link name="finger"><inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" '
        'izz="1e-4"/></inertial></link><joint name="finger" type="prismatic"><parent link="link_3"/>'
        f'<child link="finger"/><origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>{limit}</joint></robot>'
    ]
    path = folder / "arm.urdf"
    path.write_text("\n".join(parts))
    return path


def mjcf(folder):
    """Path of the arm as MJCF, without the finger."""
    full = text([INERTIA[k] for k in (0, 2, 5, 1, 3, 4)])  # MuJoCo's order: xx yy zz xy xz yz
    opened, closed = [], []
    for k, (axis, place, mass, centre) in enumerate(LINKS, 1):
        armature = f' armature="{ARMATURE}"' if k == 2 else ""
        opened.append(
            f'<body name="link_{k}" pos="{text(place)}"><joint name="j{k}" axis="{text(axis)}"{armature} damping="5" '
            f'frictionloss="3"/><inertial pos="{text(centre)}" mass="{mass}" fullinertia="{full}"/>'
        )
        closed.append("</body>")
    path = folder / "arm.xml"
    path.write_text(f'<mujoco model="arm"><option gravity="0 0 -9.81"/><worldbody>{"".join(opened + closed)}'
                    "</worldbody></mujoco>")  # fmt: skip
    return path


def motions(count, joints, seed=0):
    """Positions, velocities and accelerations at random."""
    return np.random.default_rng(seed).uniform(-2, 2, (3, count, joints))
