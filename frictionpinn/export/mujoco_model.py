"""A trained model as friction for MuJoCo: plain Python files that need numpy and mujoco alone."""

from __future__ import annotations

import json
from pathlib import Path
from string import Template
from typing import Any

from .. import __version__
from ..evaluate.mjcf import pob_mjcf
from ..numerics.torch_functions import capacity_rate
from ..physics import CONTACT, FrictionLaw
from .functions import bristle, python_function
from .portable import PortableModel
from .portable_state import PortableState

_TEMPLATES = Path(__file__).parent / "templates"


def write_mujoco(folder: Path, portable: PortableModel | PortableState) -> list[str]:
    """Write ``friction_mujoco.py``, ``friction_model.py``, its numbers, the law, and for the PoB an example.

    Of one of several contacts numbers and law carry its name, ``hinge_friction_model.json``; the rest is shared.

    Returns:
        Names of the files.
    """
    files = {
        name: (_TEMPLATES / name).read_text(encoding="utf-8") for name in ("friction_mujoco.py", "friction_model.py")
    }
    prefix = f"{portable.contact}_" if portable.contact else ""
    files[f"{prefix}friction_model.json"] = json.dumps(describe(portable)) + "\n"
    if portable.law is not None:
        files[f"{prefix}friction_law.py"] = law_module(portable.law)
    if portable.system.name == "pob":
        example = (_TEMPLATES / "simulate_pob.py").read_text(encoding="utf-8")
        files["simulate_pob.py"] = Template(example).substitute(kind=kinds(portable)[0])
        values = {name: float(value) for name, value in portable.system.values.items() if value is not None}
        files["pob.xml"] = pob_mjcf(values, timestep=portable.interval / 20)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return list(files)


def kinds(portable: PortableModel | PortableState) -> list[str]:
    """What can be simulated with."""
    return ["network"] if portable.law is None else ["law", "network"]


def describe(portable: PortableModel | PortableState) -> dict[str, Any]:
    """Everything about the model as plain values with units."""
    units, law = portable.units, portable.law
    names = {par.name: portable.system.unit(par) for par in law.parameters} if law else {}
    return {
        "title": portable.title,
        "version": __version__,
        "kinds": kinds(portable),
        "law": law.name if law else None,
        **({"law_module": f"{portable.contact}_friction_law"} if law and portable.contact else {}),
        "parameters": {name: {"value": portable.identified[name], "unit": unit} for name, unit in names.items()},
        "network_parameters": {name: {"value": portable.values[name], "unit": unit} for name, unit in names.items()},
        "signals": list(portable.signals),
        "units": units,
        "interval": {"value": portable.interval, "unit": "s"},
        "force_scale": {"value": portable.force_scale, "unit": units["force"]},
        **(_bristles(portable) if isinstance(portable, PortableState) else _windows(portable)),
    }


def _bristles(portable: PortableState) -> dict[str, Any]:
    """Of a network with memory: its table and its bristles."""
    numbers = portable.numbers
    return {name: getattr(numbers, name).tolist() for name in ("tables", "grid", "elements")}


def _windows(portable: PortableModel) -> dict[str, Any]:
    """Of a network with windows of the past."""
    return {
        "inputs": list(portable.inputs),
        "samples": portable.length,
        "z_scale": {"value": portable.z_scale, "unit": portable.units["z"]},
        "bristle": portable.bristle,
        "activation": portable.activation,
        "odd": portable.odd,
        "mean": portable.mean.tolist(),
        "scale": portable.scale.tolist(),
        "signs": portable.signs.tolist(),
        "weights": {name: rows.tolist() for name, rows in portable.weights.items()},
        "layers": [[weight.tolist(), bias.tolist()] for weight, bias in portable.layers],
    }


def law_module(law: FrictionLaw) -> str:
    """Source of a module with the law's functions of floats, parameters last."""
    c, p = CONTACT, [par.symbol for par in law.parameters]
    names = [par.name for par in law.parameters]
    rate, slope = bristle(law)
    g = law.capacity(c, law.symbols)
    g_rate, (v_rate, N_rate) = capacity_rate(law)
    functions = (
        ("force", (c.v, c.N, c.z, c.zdot), [law.force(c, law.symbols)], "Friction force."),
        ("bristle_rate", (c.v, c.N, c.z), [rate], "Rate of the bristle state z."),
        ("bristle_slope", (c.v, c.N, c.z), [slope], "Its derivative in z."),
        ("capacity", (c.v, c.N, v_rate, N_rate), [g, g_rate], "Dry friction in steady sliding, and its rate."),
    )
    head = f'"""{law.name} friction, generated from its equations by frictionpinn {__version__}; SI units."""\n\n'
    head += f"import math\n\nPARAMETERS = {names!r}\n"
    parts = [
        python_function(name, [symbol.name for symbol in (*arguments, *p)], expressions, text)
        for name, arguments, expressions, text in functions
    ]
    return "\n\n".join([head.rstrip("\n"), *parts])
