"""What there is to model with: systems, friction laws, effects, and mechanisms made of them."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping

from ..errors import UserError, choose
from ..physics import EFFECTS, LAWS, SYSTEMS, Effect, FrictionLaw, System, extensions
from ..physics.contacts import law_named
from ..physics.effects import applicable
from ..physics.mechanism import Mechanism
from ..show import Table, readable_unit
from .arguments import mechanism_given, names_given


def systems() -> Table:
    """The systems by name, with the signals and the parameters of each.

    Examples:
        >>> import frictionpinn as fp
        >>> fp.systems().to_dict()["joint"]["signals"]
        't (s), theta (rad), omega (rad/s), alpha (rad/s²), tau (N m)'
    """
    extensions.load()
    rows = []
    for name, kind in SYSTEMS.items():
        made = kind()
        signals = ", ".join(f"{signal} ({readable_unit(unit)})" for signal, unit in made.signal_units.items())
        rows.append(
            (
                name,
                kind.title,
                signals,
                ", ".join(f"{p.name} ({readable_unit(p.unit) or '1'})" for p in kind.parameters),
            )
        )
    return Table(("system", "", "signals", "parameters"), tuple(rows))


def laws() -> Table:
    """The friction laws by name, with their parameters; {F} and {L} are the system's units of force and slip.

    Examples:
        >>> import frictionpinn as fp
        >>> fp.laws().to_dict()["coulomb_viscous"]["parameters"]
        'mu_c (1), sigma_2 ({F}*s/{L})'
    """
    extensions.load()
    rows = []
    for name, law in LAWS.items():
        free = ", ".join(f"{par.name} ({par.unit})" for par in law.parameters if par.value is None)
        rows.append((name, _first_sentence(law), "yes" if law.memory else "no", free))
    return Table(("law", "", "memory", "parameters"), tuple(rows))


def effects(mechanism: Mechanism | None = None) -> Table:
    """The effects that a diagnosis knows: what each does, where it occurs and which experiment shows it.

    Args:
        mechanism: those that can act on it; None for all.

    Examples:
        >>> import frictionpinn as fp
        >>> drag = fp.effects().to_dict()["drag"]
        >>> drag["equation"], drag["occurs"]
        ('F = F_law + drag v |v|.', 'in air and water, with churned lubricant.')
    """
    extensions.load()
    kinds: Iterable[Effect | type[Effect]] = EFFECTS.values()
    if mechanism is not None:
        mechanism = mechanism_given(mechanism)
        kinds = applicable(mechanism.system, mechanism.law, [effect.name for effect in mechanism.effects])
    told = ("equation", "occurs", "experiment")
    return Table(("effect", *told), tuple((kind.name, *(kind.said().get(key, "") for key in told)) for kind in kinds))


def system(
    name: str,
    *,
    equations: str = "lagrange",
    imposed: bool = False,
    driven: Iterable[str] | None = None,
    **parameters: float,
) -> System:
    """A system with the values of its parameters.

    Args:
        name: one of :func:`systems`.
        equations: "lagrange", or "published" where a system has equations as printed.
        imposed: the motion is imposed and the force measured, for systems of one coordinate: nothing is integrated.
        driven: of a system of several coordinates those whose motion is taken as measured, ["theta_1"]: the others are
            simulated. None: as the system has it.
        parameters: masses, lengths and so on, SI units; those not given have the defaults of the system.

    Raises:
        UserError: an unknown name, a value out of its physical range.

    Examples:
        >>> import frictionpinn as fp
        >>> fp.system("drive", M=2.0)
        drive, linear drive: M = 2 kg, preload = 1 N
    """
    extensions.load()
    kind = choose(name, SYSTEMS, "system")
    taken = None if driven is None else tuple(names_given(driven, "system.driven"))
    return kind(equations=equations, driven=taken, imposed=imposed, **parameters)


def made_system(given: System | str, where: str) -> System:
    """A system as it is, or that of a name with the defaults of its parameters; ``where`` it was given, for errors."""
    extensions.load()
    made = choose(given, SYSTEMS, "system")() if isinstance(given, str) else given
    if not isinstance(made, System):
        own = isinstance(made, Mechanism)
        raise UserError("not a System", where=where, received=repr(made).partition("\n")[0][:60],
                        allowed=", ".join(SYSTEMS), fix="take the mechanism's system, mechanism.system" if own else
                        'make one: fp.system("drive", M=2.0)')  # fmt: skip
    return made


def mechanism(
    system: System | str,
    friction: FrictionLaw | str | Mapping[str, FrictionLaw | str] = "lugre",
    effects: Iterable[Effect | str] = (),
) -> Mechanism:
    """A system with a friction law, and effects that belong to it: the model that is fitted and diagnosed.

    Args:
        system: from :func:`system`, or its name for default values.
        friction: a law by name, see :func:`laws`, or one of your own; on a system with several contacts one for all, or
            one for each by its name, "none" included.
        effects: by name, see :func:`effects`, or your own; with several contacts "asymmetry@hinge".

    Raises:
        UserError: an unknown name; effects that cannot act there.

    Examples:
        >>> import frictionpinn as fp
        >>> fp.mechanism("drive", "coulomb_viscous", ["drag"]).name
        'drive+coulomb_viscous+drag'
        >>> fp.mechanism("cartpole", {"rail": "lugre", "bearing": "none"}).name
        'cartpole+lugre@rail+none@bearing'
    """
    made = made_system(system, "system")
    own = tuple(effects) if isinstance(effects, Iterable) and not isinstance(effects, str) else (None,)
    if not all(isinstance(effect, str | Effect) for effect in own):
        raise UserError("not a list of effects", where="effects", received=repr(effects), allowed="such as ['drag']")
    return Mechanism(made, law_named(friction, "friction"), own)  # type: ignore[arg-type]


def _first_sentence(kind: type) -> str:
    return (inspect.getdoc(kind) or "").partition("\n")[0]
