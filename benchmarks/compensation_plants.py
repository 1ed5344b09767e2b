"""Axes of benchmarks/compensation.py, in our simulator and in MuJoCo, none of them the compensator's model.

Each has LuGre friction with an effect that nobody declared, a load that the controller does not know of, an encoder
with steps, a delay of 1 to 2 ms and a torque limit; the trolley has a second coordinate with a second contact besides.
What controller and compensators believe is off by 20 %, every parameter up or down by a coin.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from frictionpinn.control import Plant
from frictionpinn.control.loop import Address, Foreign
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

ERROR, LOAD, VARIED = 0.2, 1.5, 0.25  # error of what is believed; load; half range of the truth
TIMESTEP = 1.25e-4  # s, of MuJoCo
ELASTIC = 40.0  # Hz, of the gear's spring between motor and link


@dataclass(frozen=True)
class Kind:
    """A kind of axis: nominal truth, effect with its parameters, and scale of the motion.

    ``loaded`` parameters are multiplied by the load; ``amplitude`` is in the unit of position; ``stream`` is that of
    the random numbers, so that a kind that is added changes no other's axes.
    """

    title: str
    system: str
    truth: dict[str, float]
    effect: str
    strengths: dict[str, float]
    loaded: tuple[str, ...]
    resolution: float
    limit: float
    amplitude: float
    stream: int
    foreign: Callable[[Plant, float], tuple[Foreign, float, object]] | None = None
    resonance: float = np.inf  # Hz, the first


# The axis points to -y, so that theta counts upwards from level, as in the joint.
_ARM = """<mujoco model="arm behind an elastic gear">
  <compiler angle="radian"/>
  <option timestep="{timestep!r}" gravity="0 0 -9.81" integrator="implicitfast"/>
  <worldbody>
    <body name="motor">
      <joint name="motor" type="hinge" axis="0 -1 0" armature="{motor!r}"/>
      <inertial pos="0 0 0" mass="1e-3" diaginertia="1e-7 1e-7 1e-7"/>
    </body>
    <body name="link">
      <joint name="link" type="hinge" axis="0 -1 0"/>
      <inertial pos="{lever!r} 0 0" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="gear" stiffness="{stiffness!r}" damping="{damping!r}" springlength="0">
      <joint joint="motor" coef="1"/>
      <joint joint="link" coef="-1"/>
    </fixed>
  </tendon>
</mujoco>
"""


def elastic_arm(plant: Plant, part: float) -> tuple[Foreign, float, object]:
    """The joint in MuJoCo: half of its inertia in the motor, half in a link that gravity pulls, a spring between."""
    p, steps = plant.parameters, round(part / TIMESTEP)
    motor = link = p["J"] / 2
    lever = 0.1
    mass = p["W_cos"] / (9.81 * lever)
    own = link - mass * lever**2
    if own <= 0:
        lever = link * 9.81 / (2 * p["W_cos"])
        mass = p["W_cos"] / (9.81 * lever)
        own = link - mass * lever**2
    stiffness = (2 * np.pi * ELASTIC) ** 2 * motor * link / (motor + link)
    damping = 0.06 * np.sqrt(stiffness * motor * link / (motor + link))
    numbers = {"motor": motor, "lever": lever, "mass": mass, "inertia": own, "stiffness": stiffness, "damping": damping}
    text = _ARM.format(timestep=TIMESTEP, **{key: float(value) for key, value in numbers.items()})
    return _opened(text, steps)


_TROLLEY = """<mujoco model="trolley with a hanging pole">
  <compiler angle="radian"/>
  <option timestep="{timestep!r}" gravity="0 0 -9.81" integrator="implicitfast"/>
  <worldbody>
    <body name="trolley">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{trolley!r}" diaginertia="1e-3 1e-3 1e-3"/>
      <body name="pole">
        <joint name="hinge" type="hinge" axis="0 1 0" damping="{damping!r}" frictionloss="{dry!r}"/>
        <inertial pos="0 0 {center!r}" mass="{pole!r}" diaginertia="{inertia!r} {inertia!r} 1e-6"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def trolley(plant: Plant, part: float) -> tuple[Foreign, float, object]:
    """The drive as a cart-pole in MuJoCo: a fifth of its mass a rod that hangs on a hinge with dry friction.

    The rod (0.4 m: 1 Hz, as the references) is a second coordinate with a second contact that no compensator declares.
    """
    mass, length = plant.parameters["M"], 0.4
    pole = mass / 5
    weight = pole * 9.81 * length / 2  # N m, of the rod held level
    numbers = {"trolley": mass - pole, "pole": pole, "center": -length / 2, "inertia": pole * length**2 / 12,
               "dry": 0.01 * weight, "damping": 0.002 * weight}  # fmt: skip
    text = _TROLLEY.format(timestep=TIMESTEP, **{key: float(value) for key, value in numbers.items()})
    return _opened(text, round(part / TIMESTEP))


def _opened(text: str, steps: int) -> tuple[Foreign, float, object]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    foreign = Foreign(_step(), model._address, data._address, data.qpos, data.qvel, data.qfrc_applied, steps)
    return foreign, TIMESTEP, (model, data)


@cache
def _step() -> Address:
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco.so*"))))
    return Address(ctypes.cast(library.mj_step, ctypes.c_void_p).value or 0)


KINDS = {
    "drive": Kind(
        "linear drive, friction higher one way",
        "drive",
        {"M": 1.0, "preload": 1.0, "sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.5,
         "v_s": 2e-3},
        "asymmetry",
        {"asymmetry": 0.12},
        ("M", "preload"),
        1e-6,
        40.0,
        5e-3,
        1,
    ),
    "joint": Kind(
        "robot joint with a gear and an arm, friction that ripples with the gear",
        "joint",
        {"J": 0.5, "W_cos": 3.0, "W_sin": 0.0, "preload": 1.0, "sigma_0": 2e3, "sigma_1": 12.0, "sigma_2": 0.8,
         "mu_c": 2.0, "mu_s": 2.8, "v_s": 2e-2},
        "ripple",
        {"ripple_friction_sin": 0.15, "ripple_sin": 0.1, "ripple_wavelength": 0.12},
        ("J", "W_cos", "preload"),
        2 * np.pi / 2**17,
        40.0,
        0.2,
        2,
    ),
    "stage": Kind(
        "positioning stage, guide with a tight place",
        "drive",
        {"M": 4.0, "preload": 1.0, "sigma_0": 1e6, "sigma_1": 2000.0, "sigma_2": 15.0, "mu_c": 10.0, "mu_s": 14.0,
         "v_s": 1e-3},
        "position_friction",
        {"position_bump": 0.3, "position_place": 2e-3, "position_width": 1.5e-3},
        ("M", "preload"),
        0.5e-6,
        150.0,
        4e-3,
        3,
    ),
    "arm": Kind(
        "arm behind an elastic gear in MuJoCo, friction higher one way",
        "joint",
        {"J": 0.3, "W_cos": 2.0, "W_sin": 0.0, "preload": 1.0, "sigma_0": 1.5e3, "sigma_1": 8.0, "sigma_2": 0.6,
         "mu_c": 1.5, "mu_s": 2.2, "v_s": 2e-2},
        "asymmetry",
        {"asymmetry": -0.12},
        ("J", "W_cos", "preload"),
        2 * np.pi / 2**17,
        30.0,
        0.2,
        0,
        elastic_arm,
        ELASTIC,
    ),
    "trolley": Kind(
        "trolley with a hanging pole in MuJoCo, rail with a tight place",
        "drive",
        {"M": 2.0, "preload": 1.0, "sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 5.0, "mu_c": 4.0, "mu_s": 5.6,
         "v_s": 1e-2},
        "position_friction",
        {"position_bump": 0.3, "position_place": 2e-2, "position_width": 1.5e-2},
        ("M", "preload"),
        1e-5,
        60.0,
        5e-2,
        4,
        trolley,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Draw:
    """An axis, what is believed of it, and the stroke that its motion takes."""

    plant: Plant
    model: Mechanism
    believed: dict[str, float]
    loaded: bool
    stroke: tuple[float, float] | None = None


@cache
def _mechanism(system: str, effects: tuple[str, ...] = ()) -> Mechanism:
    return Mechanism(SYSTEMS[system](), LAWS["lugre"](), effects)


def draw(name: str, seed: int, load: float | None = None) -> Draw:
    """The axis of a seed; odd seeds carry the load, unless ``load`` says otherwise."""
    kind = KINDS[name]
    rng = np.random.default_rng([seed, kind.stream])
    truth = {key: value * rng.uniform(1 - VARIED, 1 + VARIED) for key, value in kind.truth.items()}
    truth["preload"] = 1.0
    truth["mu_s"] = max(truth["mu_s"], 1.1 * truth["mu_c"])
    believed = {key: value * (1 + ERROR * rng.choice([-1.0, 1.0])) for key, value in truth.items() if key != "preload"}
    believed["mu_s"] = max(believed["mu_s"], believed["mu_c"])
    factor = (LOAD if seed % 2 else 1.0) if load is None else load
    truth |= {key: factor * truth[key] for key in kind.loaded}
    truth |= {key: value * rng.uniform(1 - VARIED, 1 + VARIED) for key, value in kind.strengths.items()}
    delay = 5e-4 * rng.integers(2, 5)
    plant = Plant(_mechanism(kind.system, (kind.effect,)), truth, kind.resolution, delay, kind.limit, kind.foreign)
    return Draw(plant, _mechanism(kind.system), believed | {"preload": 1.0}, factor > 1)
