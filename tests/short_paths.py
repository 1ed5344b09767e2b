"""Values of every law and a short path of every system, for tests of whatever is compiled from the physics."""

from pathlib import Path

import numpy as np
import sympy as sp
import yaml

from frictionpinn.data.excitation import parse_expression
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.system import TIME

LAW_VALUES = {
    "sigma_0": 1e5,
    "sigma_1": 316.23,
    "sigma_2": 0.4,
    "mu_c": 0.3,
    "mu_s": 0.6,
    "v_s": 1e-3,
    "alpha": 2.0,
    "v_t": 1e-4,
    "tied_inertia": 1.0,
}
SWING = sp.rad(50) * sp.sin(2 * sp.pi * TIME)
T = np.arange(161) / 400
PATHS = {
    "pob": {"theta": SWING},
    "sdob": {"y": 0.21 + 0.02 * sp.sin(9 * TIME), "force": 9 * sp.sin(7 * TIME)},
    "drive": {"force": sp.sin(7 * TIME)},
    "pendulum": {"tau": 6 * sp.sin(7 * TIME)},
    "joint": {"tau": 6 * sp.sin(7 * TIME)},
    "damper": {"x": 0.01 * sp.sin(9 * TIME)},
}
TRUTH = {}  # of a system that was added
for name in SYSTEMS.keys() - PATHS.keys():  # of a system that was added: its own first trial
    conf = Path(__file__).resolve().parents[1] / "conf" / "system" / f"{name}.yaml"
    own = yaml.safe_load(conf.read_text(encoding="utf-8"))["simulate"]
    trial, TRUTH[name] = own["trials"][0], own["truth"]
    driven = {*SYSTEMS[name].driven, *(item.name for item in SYSTEMS[name].inputs)}
    PATHS[name] = {key: parse_expression(str(text), key, {}) for key, text in trial.items() if key in driven}
EVERY = [(system, law) for system in SYSTEMS for law in LAWS]
ALL = [(system, law) for system, law in EVERY if not SYSTEMS[system].contacts]  # those with one contact
