"""Friction compensation: an identified mechanism as a torque to add beside a controller."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..control import Compensator
from ..control.build import NOTHING, build_compensator
from ..errors import UserError, unwritten
from ..export.compensator import write_compensator_c
from ..identify.result import Estimate
from ..physics import extensions
from ..physics.mechanism import Mechanism
from ..workflow.options import composed
from .arguments import mechanism_given, number_given, table_given, values_of
from .estimates import known_options


def compensate(
    mechanism: Mechanism,
    parameters: Mapping[str, float] | Estimate,
    *,
    control: str = "estimator",
    interval: float = 1e-3,
    delay: float = 0.0,
    resolution: float = 1e-6,
    known: Mapping[str, float] | None = None,
    stroke: tuple[float, float] | None = None,
    folder: str | Path | None = None,
    **options: Any,
) -> Compensator:
    """A compensator for a controller: once in every cycle, the torque that cancels the friction of an axis.

    Added is F(q_r, v_r, z_r; p) (1 + b(q_r)) + c(q_r) + d: the friction along the reference with its bristle z_r,
    parameters p that follow the machine, what depends on the place (b, c), and a disturbance d, all else that acts like
    a friction (H. Olsson and others, European Journal of Control 4, 1998). It is for one free coordinate with a force
    or torque on it: drive, joint, pendulum. One that was identified with its motion imposed is taken as the axis it is.

    Args:
        mechanism: system, friction law, effects that do not act on sensors.
        parameters: by name, SI units, or an estimate.
        control: "estimator", "feedforward", "coulomb", "stribeck" or "disturbance_observer".
        interval: cycle of the controller, s.
        delay: from a command to its effect, s; the reference is given that much ahead.
        resolution: step of the encoder, in the system's unit of position.
        known: where the torque that the controller itself computes for the motion is of other parameters, these.
        stroke: first and last position of the axis's motion, between which friction that depends on the place is
            learned; None: it is not.
        folder: where ``compensator.h`` and ``compensator.c`` (C99) are written; None: nowhere.
        options: as in conf/control: ``bandwidth`` (Hz, at most half of the axis's first resonance), ``disturbance``,
            ``uneven`` and ``limit`` (in dry friction), ``cells``, ``adapt`` and ``spread`` (by parameter),
            ``friction``, ``transition``.

    Returns:
        An object with ``update(reference, position, torque)``, which returns torque, low and high (95 % interval), in
        the system's unit of force; reference: position, velocity and acceleration, shape (3,); torque: commanded last.

    Raises:
        UserError: a mechanism that is no such axis; a parameter that is unknown, missing or out of its range, or mu_s
            below mu_c; ``adapt`` of a parameter that is 0; an unknown compensator or option.

    Examples:
        >>> import frictionpinn as fp
        >>> model = fp.mechanism(fp.system("drive", M=2.0), "coulomb_viscous")
        >>> compensator = fp.compensate(model, {"mu_c": 3.0, "sigma_2": 2.0}, control="feedforward")
        >>> command = compensator.update((0.0, 0.1, 0.0), position=0.0, torque=0.0)  # m, m/s, m/s^2; m; N
        >>> round(command.torque, 2)
        3.2
    """
    extensions.load()
    mechanism, known = mechanism_given(mechanism), table_given(known, "known") or None
    for key in ("transition", "disturbance", "bandwidth", "limit", "uneven", "gain"):
        if options.get(key) is not None:
            number_given(options[key], key)
    if folder is not None and (not isinstance(folder, str | Path) or Path(folder).is_file()):
        raise UserError("no folder", where="folder", received=folder, allowed="a folder, made where there is none")
    config = composed("compensate", [f"control={control}"])["control"]
    if config["name"] == NOTHING:
        raise UserError("no compensator", where="control", received=control, fix="a controller alone needs none")
    known_options("compensate", options, [key for key in config if key != "name"])
    values, axis = values_of(parameters), freed(mechanism)
    axis.check_names(values, "parameters")
    for key in ("adapt", "spread"):
        if isinstance(options.get(key), Mapping):
            axis.check_names(options[key], f"compensate.{key}")
    loop = {"interval": interval, "delay": delay, "resolution": resolution, "known": known, "stroke": stroke}
    made = build_compensator(config | options, axis, values, **loop)
    assert made is not None
    left, unmatched = ([n for n in options.get(key) or () if n not in made.adapt] for key in ("adapt", "spread"))
    for key, read, allowed in (
        ("transition", "v_t" in made.names and "v_s" in values, "with a law that has v_t, beside a v_s"),
        ("bandwidth", made.plan.filters, "where a disturbance, a parameter or a place is learned"),
        ("cells", made.plan.cells, "with a stroke, and uneven above 0"),
        ("uneven", made.plan.cells or options.get("uneven") == 0, "with a stroke"),
        ("adapt", not left, f"of parameters above 0 that the compensator has, not of {', '.join(left)}"),
        ("spread", not unmatched, f"of parameters in adapt, not of {', '.join(unmatched)}"),
    ):
        if options.get(key) is not None and not read:
            raise UserError("an option that nothing reads", where=key, received=options[key], allowed=allowed,
                            fix="leave it out")  # fmt: skip
    if folder is not None:
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
            write_compensator_c(Path(folder), made)
        except OSError as error:
            raise unwritten(error, folder, "name another folder") from error
    return made


def freed(mechanism: Mechanism) -> Mechanism:
    """The mechanism with its motion free, where it was declared as imposed."""
    system = mechanism.system
    if not system.imposed:
        return mechanism
    values: dict[str, Any] = dict(system.values)
    return Mechanism(type(system)(equations=system.equations, **values), mechanism.law, mechanism.effects)
