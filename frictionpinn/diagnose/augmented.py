"""The augmented model as a file: system, law, effects and values, to simulate with and to train on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..errors import UserError, choose
from ..physics import LAWS, SYSTEMS
from ..physics.mechanism import Mechanism
from .diagnosis import Diagnosis

_HEAD = "# A friction model with the effects that a diagnosis added: python train.py friction=<this file>\n"


def save_augmented(path: Path, d: Diagnosis, cfg: Mapping[str, Any]) -> Mechanism:
    """Write the declared model with the added effects; return its mechanism."""
    system, law = d.bench.mechanism.system, d.bench.mechanism.law
    present = [e.name for e in d.bench.mechanism.effects]
    effects = list(dict.fromkeys([*present, *(a.candidate.effect for a in d.accepted)]))
    mechanism = Mechanism(system, law, tuple(effects))  # type: ignore[arg-type]
    own = [par.name for par in law.parameters]
    masses = {par.name for par in system.parameters}
    table = d.after.values
    values = {par.name: float(table[par.name]) for par in mechanism.parameters if par.name in table}
    content = {
        "name": law.name,
        "system": {"name": system.name, "equations": system.equations, "imposed": system.imposed,
                   "parameters": {n: v for n, v in values.items() if n in masses}},
        "values": {n: v for n, v in values.items() if n in own},
        "effects": {
            e.name: {par.name: values[par.name] for par in e.parameters_on(system, law) if par.name in values
                     and par.name not in own}
            for e in mechanism.effects
        },
    }  # fmt: skip
    path.write_text(_HEAD + yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return mechanism


def load_augmented(path: str | Path) -> tuple[Mechanism, dict[str, float]]:
    """Mechanism and all its values from a file that a diagnosis wrote.

    Raises:
        UserError: no such file, or not one of these.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError("no such friction model", where="friction", received=str(path),
                        allowed="augmented.yaml of a diagnosis", fix="give the path of that file")  # fmt: skip
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        given, effects = content["system"], content["effects"]
        kind = choose(given["name"], SYSTEMS, "system")
        system = kind(equations=given["equations"], imposed=given["imposed"], **given["parameters"])
        mechanism = Mechanism(system, choose(content["name"], LAWS, "friction")(), tuple(effects))
        values = dict(content["values"]) | {k: v for table in effects.values() for k, v in table.items()}
    except (KeyError, TypeError, AttributeError, yaml.YAMLError) as error:
        raise UserError("not a friction model", where="friction", received=str(path),
                        allowed="augmented.yaml of a diagnosis", fix=f"look at {error!r}") from error  # fmt: skip
    return mechanism, {k: float(v) for k, v in values.items()} | system.values
