"""An identified robot for other simulators: MJCF, URDF, Isaac Lab, bam; with what each cannot say and what that costs.

Public: :func:`hand_on`, :data:`FORMS`.

* ``mjcf``: armature, damping, frictionloss of every joint; a joint with a bristle gets MuJoCo's own LuGre friction, a
  ``dcmotor`` actuator without inputs (mujoco 3.7 on; before that frictionloss stands for it).
* ``urdf``: ``<dynamics damping= friction=>`` of every joint. A URDF has no place for a motor's inertia.
* ``isaaclab``: arguments of an actuator's configuration by joint: ``armature``, ``friction`` (static),
  ``dynamic_friction``, ``viscous_friction``, torques as Isaac Sim 5 takes them.
* ``bam``: for each joint the parameters of the smallest of its models M1 to M4 that has what the joint needs. Its load
  is that of both sides of the gear together, in slow motion twice what the joint transmits.

Where bodies were estimated, MJCF and URDF get their masses, centres and inertias, too.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from ..errors import UserError, choose
from ..export.extras import require
from ..physics.robot import Robot, _pinocchio
from ..show import Shown, Table
from .arm import Arm
from .targets import Reduced, Target, names_of, reduce

DCMOTOR = (3, 7)  # version of mujoco that brought LuGre friction
RESISTANCE = "1"  # ohm, of a dcmotor that only rubs: it has to be above 0, and carries no current


@dataclass(frozen=True, repr=False)
class HandedOn(Shown):
    """Files that were written, and what they cannot say.

    Attributes:
        files: form -> paths.
        rows: of each form and joint.
        notes: what else a user has to know.
    """

    files: dict[str, list[Path]]
    rows: tuple[Reduced, ...]
    notes: tuple[str, ...] = ()

    def tables(self) -> list[Table]:
        """By form and joint: what is left out, and the error of the torque that this costs."""
        lines = [
            (f"{row.target} {row.joint}", ", ".join(row.left_out) or "nothing", f"{100 * row.error:.2g} %",
             f"{100 * row.inertia_error:.2g} %" if row.inertia_error else "")
            for row in self.rows
        ]  # fmt: skip
        columns = ("form, joint", "left out", "friction off by", "motor's inertia lost")
        return [Table(columns, tuple(lines), "rms along the motion, relative to the joint's friction", self.notes)]

    def to_dict(self) -> dict[str, Any]:
        """Files and rows."""
        return {"files": {form: [path.name for path in paths] for form, paths in self.files.items()},
                "joints": [asdict(row) for row in self.rows], "notes": list(self.notes)}  # fmt: skip


def hand_on(
    arm: Arm,
    file: str | Path,
    folder: str | Path,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    forms: Sequence[str] = ("mjcf", "urdf", "isaaclab", "bam"),
) -> HandedOn:
    """Write an arm in other simulators' forms, each with ``torque_error.json`` to ``<folder>/<form>/``, and
    ``torque_error.txt`` beside them.

    Args:
        arm: with its values.
        file: URDF or MJCF that it was read from.
        folder: is made where there is none.
        motion: t, even steps, shape (n,), and q, v, a, shape (n, joints): what the arm is used for, by which forms that
            lack something are fitted and judged.
        forms: of :data:`FORMS`.

    Raises:
        UserError: an unknown form, a URDF asked for from an MJCF, mujoco that is not installed.
    """
    t, q, v, a = (np.asarray(x, float) for x in motion)
    source, files, rows, notes = Path(file).expanduser(), {}, [], []
    for form in forms:
        write, target = choose(form, FORMS, "export")
        target = target() if callable(target) else target
        reduced = reduce(arm, target, t, q, v, a)
        place = Path(folder) / form
        place.mkdir(parents=True, exist_ok=True)
        files[form] = write(arm, source, place, reduced)
        rows += reduced
    if arm.estimated and {"mjcf", "urdf"} & set(forms) and _moving(source) != len(arm.robot.joints):
        notes.append("masses and inertias are those of the file: it has joints that move and were not recorded")
    if arm.misfit > 1e-6:
        notes.append("no bodies that can exist have the estimated inertias: the nearest that can are written")
    result = HandedOn(files, tuple(rows), tuple(notes))
    for name in names_of(rows):
        own = [asdict(row) for row in rows if row.target == name]
        _write(Path(folder) / name / "torque_error.json", json.dumps(own, indent=2))
    _write(Path(folder) / "torque_error.txt", "\n".join(table.text() for table in result.tables()) + "\n")
    return result


def _moving(source: Path) -> int:
    """Number of joints of a robot file that can move; -1 where one has several degrees of freedom."""
    try:
        return len(Robot.read(source).joints)
    except UserError:
        return -1


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def _number(value: float) -> str:
    return f"{value:.9g}"


# URDF -----------------------------------------------------------------------------------------------------------
def _urdf(arm: Arm, source: Path, folder: Path, rows: Sequence[Reduced]) -> list[Path]:
    if source.suffix != ".urdf":
        raise UserError("a URDF is made from a URDF alone", where="export", received=source.name,
                        allowed="mjcf, isaaclab, bam")  # fmt: skip
    tree = ET.parse(source)
    root = tree.getroot()
    joints = {item.get("name"): item for item in root.findall("joint")}
    for name, row in zip(arm.robot.joints, rows, strict=True):
        dynamics = joints[name].find("dynamics")
        if dynamics is None:
            dynamics = ET.SubElement(joints[name], "dynamics")
        dynamics.set("damping", _number(row.values.get("sigma_2", 0.0)))
        dynamics.set("friction", _number(row.values.get("mu_c", 0.0)))
    moving = [name for name, item in joints.items() if item.get("type") != "fixed"]
    if arm.estimated and set(moving) == set(arm.robot.joints):
        _urdf_bodies(arm, root, joints)
    path = folder / source.name
    tree.write(path, encoding="utf-8", xml_declaration=True)
    return [path]


def _urdf_bodies(arm: Arm, root: ET.Element, joints: dict) -> None:
    """Write the bodies: what a joint moves is one, at the link that it turns; links fixed to that have no mass."""
    links = {item.get("name"): item for item in root.findall("link")}
    fixed: dict[str, list[str]] = {}
    for item in joints.values():
        if item.get("type") == "fixed":
            fixed.setdefault(item.find("parent").get("link"), []).append(item.find("child").get("link"))
    for name in arm.robot.joints:
        rest = [joints[name].find("child").get("link")]
        own = links[rest[0]]
        while rest:
            link = rest.pop()
            rest += fixed.get(link, [])
            for inertial in links[link].findall("inertial"):
                links[link].remove(inertial)
        body = arm.robot.model.inertias[arm.robot.model.getJointId(name)]
        made = ET.SubElement(own, "inertial")
        ET.SubElement(made, "origin", xyz=" ".join(map(_number, body.lever)), rpy="0 0 0")
        ET.SubElement(made, "mass", value=_number(body.mass))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
        about = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
        ET.SubElement(made, "inertia", {name: _number(value) for name, value in about.items()})


# MJCF -----------------------------------------------------------------------------------------------------------
def _has_dcmotor() -> bool:
    require("mujoco", "mujoco")
    import mujoco

    return tuple(int(x) for x in mujoco.__version__.split(".")[:2]) >= DCMOTOR


def _mjcf(arm: Arm, source: Path, folder: Path, rows: Sequence[Reduced]) -> list[Path]:
    require("mujoco", "mujoco")
    import mujoco

    if source.suffix == ".urdf":  # meshes are no part of the dynamics, and often not at hand
        root = ET.parse(source).getroot()
        for link in root.findall("link"):
            for item in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(item)
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    else:
        spec = mujoco.MjSpec.from_file(str(source))
        for kind in ("meshdir", "texturedir"):  # the file moves, its meshes do not
            setattr(spec, kind, str((source.resolve().parent / getattr(spec, kind)).resolve()))
    model = spec.compile()
    root = ET.fromstring(spec.to_xml())
    pairs = [(joint, body) for body in root.iter("body") for joint in body.findall("joint")]
    joints = {joint.get("name", ""): joint for joint, _ in pairs}
    parents = {joint.get("name", ""): body for joint, body in pairs}
    actuator = root.find("actuator")
    actuator = ET.SubElement(root, "actuator") if actuator is None else actuator
    for name, row in zip(arm.robot.joints, rows, strict=True):
        joint, p = joints[name], row.values
        joint.set("armature", _number(row.armature))
        joint.set("damping", _number(p.get("sigma_2", 0.0)))
        joint.set("frictionloss", _number(0.0 if "sigma_0" in p else p.get("mu_c", 0.0)))
        if "sigma_0" in p:
            lugre = (p["sigma_0"], p["sigma_1"], p["mu_c"], p["mu_s"], p["v_s"])
            ET.SubElement(actuator, "dcmotor", name=f"friction_{name}", joint=name, input="none", motorconst="0",
                          resistance=RESISTANCE, lugre=" ".join(map(_number, lugre)))  # fmt: skip
    if arm.estimated and model.nv == len(arm.robot.joints):
        _mjcf_bodies(arm, model, parents)
    ET.indent(root)
    path = _write(folder / f"{source.stem}.xml", ET.tostring(root, encoding="unicode") + "\n")
    mujoco.MjModel.from_xml_path(str(path))  # it can be read
    return [path]


def _mjcf_bodies(arm: Arm, model: Any, parents: dict[str, ET.Element]) -> None:
    """Write the bodies, from the frames of pinocchio's joints in MuJoCo's; what is fixed to one has no mass."""
    import mujoco

    pin, own, data = _pinocchio(), arm.robot.model, mujoco.MjData(model)
    for name in arm.robot.joints:
        data.qpos[model.joint(name).qposadr[0]] = 0.0
    mujoco.mj_kinematics(model, data)
    frames = own.createData()
    pin.forwardKinematics(own, frames, arm.robot._configured(np.zeros((1, len(arm.robot.joints))))[0])
    for name in arm.robot.joints:
        k, place = own.getJointId(name), int(model.jnt_bodyid[model.joint(name).id])
        frame = pin.SE3(data.xmat[place].reshape(3, 3), data.xpos[place])
        inertia = frame.actInv(frames.oMi[k]).act(own.inertias[k])
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.inertia
        _set_inertial(parents[name], inertia.mass, inertia.lever, (xx, yy, zz, xy, xz, yz))
        rest = parents[name].findall("body")
        while rest:
            child = rest.pop()
            if child.find("joint") is None:
                _set_inertial(child, 0.0, (0, 0, 0), None)
                rest += child.findall("body")


def _set_inertial(body: ET.Element, mass: float, centre: Sequence[float], full: Sequence[float] | None) -> None:
    for old in body.findall("inertial"):
        body.remove(old)
    made = ET.Element("inertial", pos=" ".join(map(_number, centre)), mass=_number(mass))
    if full is None:
        made.set("diaginertia", "0 0 0")
    else:
        made.set("fullinertia", " ".join(map(_number, full)))
    body.insert(0, made)


# JSON -----------------------------------------------------------------------------------------------------------
def _isaaclab(arm: Arm, source: Path, folder: Path, rows: Sequence[Reduced]) -> list[Path]:
    joints = arm.robot.joints
    table = {
        "joint_names_expr": list(joints),
        "armature": {name: row.armature for name, row in zip(joints, rows, strict=True)},
        "friction": {name: row.static for name, row in zip(joints, rows, strict=True)},
        "dynamic_friction": {name: row.values.get("mu_c", 0.0) for name, row in zip(joints, rows, strict=True)},
        "viscous_friction": {name: row.values.get("sigma_2", 0.0) for name, row in zip(joints, rows, strict=True)},
    }
    return [_write(folder / "actuator.json", json.dumps(table, indent=2) + "\n")]


def _bam(arm: Arm, source: Path, folder: Path, rows: Sequence[Reduced]) -> list[Path]:
    paths = []
    for name, row in zip(arm.robot.joints, rows, strict=True):
        p = row.values
        stribeck, load = "mu_s" in p, "load_friction" in p
        dry = p.get("mu_c", 0.0)
        table: dict[str, Any] = {"model": f"m{1 + stribeck + 2 * load}", "friction_base": dry,
                                 "friction_viscous": p.get("sigma_2", 0.0), "armature": row.armature}  # fmt: skip
        if stribeck:
            table |= {"friction_stribeck": p["mu_s"] - dry, "dtheta_stribeck": p["v_s"], "alpha": p["alpha"]}
        if load:
            table["load_friction_base"] = p["load_friction"] / 2
        if load and stribeck:
            table["load_friction_stribeck"] = p["load_friction"] / 2 * (p["mu_s"] / dry - 1 if dry else 0.0)
        paths.append(_write(folder / f"{name}.json", json.dumps(table, indent=2) + "\n"))
    return paths


Writer = Callable[[Arm, Path, Path, Sequence[Reduced]], list[Path]]
FORMS: dict[str, tuple[Writer, Any]] = {
    "mjcf": (_mjcf, lambda: Target("mjcf", armature=True, memory=_has_dcmotor())),
    "urdf": (_urdf, Target("urdf", armature=False)),
    "isaaclab": (_isaaclab, Target("isaaclab", armature=True)),
    "bam": (_bam, Target("bam", armature=True, stribeck=True, load=True, rotor=True)),
}
