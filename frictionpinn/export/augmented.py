"""The augmented model as a file: system, law, effects and values, to simulate with and to train on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import sympy as sp
import yaml

from ..diagnose.diagnosis import Diagnosis
from ..errors import UserError, choose
from ..physics import SYSTEMS, extensions
from ..physics.base import CONTACT, SESSION, TIME, TRIAL
from ..physics.contacts import law_named
from ..physics.mechanism import Mechanism
from ..physics.remainder import remainders
from ..physics.system import System

_HEAD = "# A friction model with the effects that a diagnosis added"
_TRAIN = ": python train.py friction=<this file>"  # of one contact: networks learn one


def save_augmented(path: Path, d: Diagnosis, data: Mapping[str, Any] | None = None) -> Mechanism:
    """Write the declared model with the added effects; return its mechanism.

    ``data`` are the options of the recording that was diagnosed: a training of this file is on that.
    """
    system, law = d.bench.mechanism.system, d.bench.mechanism.law
    names = [*(e.name for e in d.bench.mechanism.effects), *(a.candidate.effect for a in d.accepted)]
    network = () if d.network is None else (d.network.effect,)
    mechanism = Mechanism(system, law, (*dict.fromkeys(names), *network))  # type: ignore[arg-type]
    table = d.after.values if d.network is None else d.network.fit.values
    own = {par.name for par in law.parameters}
    masses = {par.name for par in system.parameters}
    values = {par.name: float(table[par.name]) for par in mechanism.parameters if par.name in table}
    content = {
        "name": law.name,
        **({"contacts": {at.name: at.law.name for at in mechanism.contacts}} if len(mechanism.contacts) > 1 else {}),
        "system": {"name": system.name, "equations": system.equations, "imposed": system.imposed,
                   "driven": list(system.driven), "parameters": {n: v for n, v in values.items() if n in masses}},
        "values": {n: v for n, v in values.items() if n in own},
        "effects": {
            e.name: {par.name: values[par.name] for par in e.parameters_on(system, law)
                     if par.name in values and par.name not in own}
            for e in mechanism.effects
        },
    }  # fmt: skip
    effects = [getattr(e, "effect", e) for e in mechanism.effects]  # one at a contact holds the user's
    if files := extensions.files_of([system, *(at.law for at in mechanism.contacts), *effects]):
        content["extensions"] = files
    if data is not None:
        paths = data.get("path")
        there = [str(Path(p).absolute()) for p in (paths if isinstance(paths, list) else [paths])] if paths else []
        content["data"] = dict(data) | ({"path": there} if there else {})
    head = _HEAD + (_TRAIN if len(mechanism.contacts) == 1 else "") + "\n"
    path.write_text(head + yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return mechanism


def load_augmented(path: str | Path) -> tuple[Mechanism, dict[str, float]]:
    """Mechanism and all its values, SI units, from a file that a diagnosis wrote.

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
        extensions.load(content.get("extensions", ()))
        kind = choose(given["name"], SYSTEMS, "system")
        driven = tuple(given["driven"]) if "driven" in given else None  # earlier files do not tell
        system = kind(equations=given["equations"], driven=driven, imposed=given["imposed"], **given["parameters"])
        networks = {r.name: r for r in remainders(system)}
        acting = tuple(networks.get(name, name) for name in effects)
        mechanism = Mechanism(system, law_named(content.get("contacts") or content["name"], "friction"), acting)  # type: ignore[arg-type]
        values = dict(content["values"]) | {k: v for table in effects.values() for k, v in table.items()}
    except (KeyError, TypeError, AttributeError, yaml.YAMLError) as error:
        raise UserError("not a friction model", where="friction", received=str(path),
                        allowed="augmented.yaml of a diagnosis", fix=f"look at {error!r}") from error  # fmt: skip
    return mechanism, {k: float(v) for k, v in values.items()} | system.values


def data_of(path: str | Path) -> dict[str, Any]:
    """Options of the recording that a saved model was found on; empty where it does not tell."""
    return dict(yaml.safe_load(Path(path).read_text(encoding="utf-8")).get("data") or {})


def folded(path: str | Path) -> tuple[System, dict[str, float]]:
    """The system of a saved model with the effects as known forces and loads, and the law's values, to train on.

    E + J F_effect = 0 takes the place of E, and the normal force is the one that the law sees, so that what is learned
    is the law's friction alone.

    Raises:
        UserError: see :func:`load_augmented`; an effect with a state, a sensor or a delay, or that depends on time.
    """
    mechanism, values = load_augmented(path)
    system, law, p, seen = mechanism.system, mechanism.law, mechanism.p, mechanism._seen
    for effect in mechanism.effects:
        terms = sp.Tuple(effect.force(CONTACT, p, law), effect.load(CONTACT.N, CONTACT, p))
        shown = any(effect.sensor(system, n, s, p) != s for n, s in mechanism.predictions.items())
        timed = bool(terms.free_symbols & {TIME, SESSION, TRIAL})
        if effect.states or effect.memory or effect.delays(system, law) or shown or timed:
            raise UserError(f"effect {effect.name} cannot be folded into the equation of motion", where="friction",
                            received=str(path), allowed="effects that add a force, a load or a mass",
                            fix="simulate with load_augmented, or diagnose without this effect")  # fmt: skip
    own = [par for e in mechanism.effects for par in e.parameters_on(system, law)]
    numbers = {par.symbol: sp.Float(values.get(par.name, par.value)) for par in own}
    force = mechanism._in_motion(sum((e.force(seen, p, law) for e in mechanism.effects), start=sp.Integer(0)))
    load = mechanism._in_motion(seen.N).xreplace(numbers)
    rows = {
        c.name: (mechanism._replaced(system.residual(c)) + system.jacobian[c.name] * force).xreplace(numbers)
        for c in system.moving
    }

    class Folded(type(system)):  # type: ignore[misc]
        def residual(self, coordinate):
            return rows[coordinate.name]

        @property
        def N(self):
            return load

    own_values = {par.name: values[par.name] for par in system.parameters}
    made = Folded(equations=system.equations, driven=system.driven, imposed=system.imposed, **own_values)
    return made, {par.name: values[par.name] for par in law.parameters if par.name in values}
