"""The C program that simulates a system with the exported friction in its equation of motion."""

from __future__ import annotations

import sympy as sp

from ..errors import UserError
from ..numerics.explicit import FORCE, explicit_motion
from ..physics import LAWS
from ..physics.mechanism import Mechanism
from .functions import c_statements
from .portable import PortableModel

_LAW = """    if (use_law) {
        const friction_law *p = &friction_law_identified;
        double z = s->z;
        const double v = (s->before.slip + now.slip) / 2.0, N = (s->before.normal + now.normal) / 2.0;
        (void)friction_law_step(p, &z, v, N, s->k > 0 ? s->h : 0.0);
        force = friction_law_force(p, now.slip, now.normal, z, friction_law_bristle_rate(p, now.slip, now.normal, z));
        if (keep)
            s->z = z;
    }"""


def simulate_source(portable: PortableModel) -> str | None:
    """``simulate.c``; None of several contacts, or where the motion is imposed or the normal force depends on the
    accelerations sought."""
    from .c_code import fill

    system = portable.system
    if portable.contact:
        return None
    mechanism = Mechanism(system, LAWS["coulomb"]())
    try:
        equations = explicit_motion(system)
    except UserError:
        return None
    if not equations.accelerations:
        return None
    m, inputs = len(mechanism.free), mechanism.inputs
    names = ["F", *(f"y[{i}]" for i in range(2 * m)), *(f"u[{i}]" for i in range(len(inputs)))]
    places = {
        symbol: sp.Symbol(name, real=True) for symbol, name in zip((FORCE, *equations.known), names, strict=False)
    }
    places |= {par.symbol: sp.Float(system.values[par.name]) for par in system.parameters}
    motion = [*equations.accelerations, equations.slip_acceleration]
    return fill(
        "simulate.c",
        title=system.title,
        stride=16,
        which="network" if portable.law is None else "law|network",
        inputs=", ".join(mechanism.input_signals),
        state=", ".join(c.signals[k] for k in (0, 1) for c in mechanism.free),
        m=m,
        u=len(inputs),
        contact=_assign(list(equations.contact), places, ("y", "u")),
        motion=_assign(motion, places, ("F", "y", "u")),
        scale=repr(portable.force_scale),
        **_friction(portable),
    )


def _assign(expressions: list[sp.Expr], places: dict[sp.Symbol, sp.Expr], arguments: tuple[str, ...]) -> str:
    found = [sp.sympify(expr).xreplace(places) for expr in expressions]
    used = {symbol.name.partition("[")[0] for expr in found for symbol in expr.free_symbols}
    unused = "".join(f"    (void){name};\n" for name in arguments if name not in used)
    return unused + c_statements({f"out[{i}]": expr for i, expr in enumerate(found)})


_SOURCES = {
    "v_slip": ("now.slip", "now.slip_acceleration"),
    "normal_force": (
        "now.normal",
        "s->k > 0 ? (now.normal - s->before.normal) / s->h : (s->next.normal - now.normal) / s->h",
    ),
    "a_frictionless": (
        "now.frictionless",
        "s->k > 0 ? (now.frictionless - s->before.frictionless) / s->h "
        ": (s->next.frictionless - now.frictionless) / s->h",
    ),
}


def _friction(portable: PortableModel) -> dict[str, str]:
    lines = [f"        in.{name} = {_SOURCES[name][0]};" for name in portable.signals]
    if portable.estimator:
        lines += [f"        in.{name}_rate = {_SOURCES[name][1]};" for name in portable.signals]
    network = [
        "        friction_signals in;",
        *lines,
        "        force = friction_network_force(&s->network, &in);",
        "        if (keep)",
        "            friction_network_keep(&s->network, &in);",
    ]
    branch = [_LAW, "    else {", *network, "    }"] if portable.law else ["    {", *network, "    }"]
    body = [
        *(["static int use_law;", ""] if portable.law else []),
        "/* The model's force where the force F leads; kept only when it has been found. */",
        "static double friction(simulation *s, double F, int keep)",
        "{",
        "    const state now = end(s, F);",
        "    double force;",
        *branch,
        "    if (keep) {",
        "        s->earlier = s->before;",
        "        s->before = now;",
        "    }",
        "    return force;",
        "}",
    ]
    check = [
        '    if (argc != 2 || (strcmp(argv[1], "network")@)) {',
        '        fprintf(stderr, "usage: %s #\\n", argv[0]);',
        "        return 2;",
        "    }",
    ]
    law = ' && strcmp(argv[1], "law")' if portable.law else ""
    usage = "law|network" if portable.law else "network"
    choose = "\n".join(check).replace("@", law).replace("#", usage)
    if portable.law:
        choose += '\n    use_law = !strcmp(argv[1], "law");'
    members = "    double z;\n" if portable.law else ""
    return {"friction": "\n".join(body), "members": members + "    friction_network network;", "choose": choose}
