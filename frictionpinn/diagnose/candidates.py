"""What may be missing: effects with a name, and forces that depend on one variable in any smooth way.

Also where a fitted model was during the recording, which tells what hidden parameters to try, and the values of an
effect that no mechanism can have.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..numerics.simulate import Simulation
from ..physics.base import CONTACT, FrictionLaw, at_contact, contact_of
from ..physics.contacts import LocatedEffect
from ..physics.effect import Effect, applied, hidden, load_varies, strength
from ..physics.effects import applicable
from ..physics.scan import data_scales
from ..physics.system import System
from .bench import Bench

# Where the data do not tell several effects apart, the one that occurs more often stands first.
USUAL = ("friction", "constant_force", "asymmetry", "viscous", "payload", "inertia", "stribeck", "presliding",
         "spring_force", "delay")  # fmt: skip
BUMPS = 8  # of a remainder: shapes that vary within an eighth of the range of its variable
LIMIT = 0.99  # of the way to a limit is at it: searches may stop just short
POWER = 0.95  # share of the slip velocity's power below the frequency of the fastest motion: beyond is noise
Scales = Mapping[str, tuple[float, float]]  # see data_scales


@dataclass(frozen=True)
class Candidate:
    """Strengths that are tested together.

    Attributes:
        effect: name of the effect.
        group: of its strengths.
        strengths: parameters that are neutral as declared.
        hidden: parameters that shape the effect and are estimated with it.
        grid: values of those to try, SI units; one empty table where there are none.
        bends: see :class:`frictionpinn.physics.effect.Effect`.
    """

    effect: str
    group: str
    strengths: tuple[str, ...]
    hidden: tuple[str, ...] = ()
    grid: tuple[Mapping[str, float], ...] = ({},)
    bends: bool = False

    @property
    def name(self) -> str:
        """Effect, and its group where there are several."""
        return self.effect if self.group == self.effect else f"{self.effect} ({self.group})"

    @property
    def usual(self) -> int:
        """Rank among effects that the data do not tell apart: faults of sensors last."""
        kind = self.effect.partition("@")[0]
        return USUAL.index(kind) if kind in USUAL else len(USUAL) + kind.startswith("sensor_")


def effects_for(system: System, law: FrictionLaw, names: Iterable[str] | None = None) -> tuple[Effect, ...]:
    """Every effect that can act on a system with a law, or the named ones among them, as objects.

    Of several contacts a name is of the effect at one, ``asymmetry@hinge``, or at each, ``asymmetry``.
    """
    every = applicable(system, law, tuple(effect.name for effect in applicable(system, law)))
    wanted = {e.name for e in every} if names is None else set(names)
    return tuple(e for e in every if {e.name, e.name.partition("@")[0]} & wanted)


def candidates(
    effects: Sequence[Effect], system: System, law: FrictionLaw, covered: Mapping[str, Scales]
) -> tuple[Candidate, ...]:
    """All groups of strengths of the effects.

    Args:
        covered: what the data cover at each contact, see :func:`scales`.
    """
    result = []
    for effect in effects:
        table = {par.name: par for par in effect.parameters_on(system, law)}
        for group, strengths in effect.groups(system, law).items():
            shapes = [par for par in table.values() if par.hidden and par.scan and par.group in ("", group)]
            own = covered[contact_of(next(iter(table)))]
            axes = [[(par.name, float(v)) for v in par.scan.values(own)] for par in shapes if par.scan]
            grid = tuple(dict(point) for point in itertools.product(*axes))
            free = tuple(par.name for par in shapes if par.scan and par.scan.count > 1)
            result.append(Candidate(effect.name, group, strengths, free, grid, effect.bends))
    return tuple(result)


class Bumps(Effect):
    """F = F_law + sum_k c_k b_k(x), and the law sees N (1 + sum_k d_k b_k(x)): what no named effect explains.

    b_k(x) = exp(-(x - x_k)^2 / h^2) are bumps at distances h over the range of the variable x. The c are one group of
    strengths ("force"), the d another ("friction").

    Units: c in the system's unit of force, d dimensionless.
    Neutral: all c, d = 0.
    """

    def __init__(self, variable: str, symbol: sp.Expr):
        self.variable, self.symbol, self.name = variable, symbol, f"remainder_{variable}"
        self.place = f"{variable}_from", f"{variable}_step"  # hidden parameters: x_0 and h

    def make_parameters(self, system: System, law: FrictionLaw):
        made = [strength(f"force_{self.variable}_{k}", "{F}", "", group="force") for k in range(BUMPS)]
        made += [strength(f"friction_{self.variable}_{k}", "1", "", group="friction") for k in range(BUMPS)]
        first, step = self.place
        return (*made, hidden(first, "", "", 0.0, low=-np.inf), hidden(step, "", "", 1.0))

    def _sum(self, group: str, p) -> sp.Expr:
        first, step = (getattr(p, name) for name in self.place)
        away = (self.symbol - first) / step
        return sum(getattr(p, f"{group}_{self.variable}_{k}") * sp.exp(-((away - k) ** 2)) for k in range(BUMPS))

    def force(self, c, p, law):
        return self._sum("force", p)

    def load(self, N, c, p):
        return N * (1 + self._sum("friction", p))


class Remainder(LocatedEffect):
    """What no named effect explains at a contact, as a sum of :class:`Bumps` over one variable.

    Attributes:
        variable: that it depends on; with several contacts at which, ``velocity@hinge``.
        symbol: of it.
        place: names of the hidden parameters that place the bumps.
    """

    def __init__(self, variable: str, symbol: sp.Expr, contact: str = ""):
        plain = Bumps(variable, symbol)
        super().__init__(plain, contact)
        self.variable, self.symbol = self._here(variable), symbol
        self.place = tuple(at_contact(contact, name) for name in plain.place)

    def bumps(self, x: np.ndarray, places: Mapping[str, float]) -> np.ndarray:
        """b_k at samples x of the variable, shape (n,) -> (n, BUMPS)."""
        first, step = (places[name] for name in self.place)
        return np.exp(-((((x - first) / step)[:, None] - np.arange(BUMPS)) ** 2))


def remainders(system: System) -> tuple[Remainder, ...]:
    """One for each variable on which a force along the slip of a contact may depend: its own, then measured ones."""
    return tuple(Remainder(*item, c.name) for c in system.contacts for item in _variables(system.at(c.name)).items())


def _variables(system: System) -> dict[str, sp.Expr]:
    """What a force at a contact may depend on, by name."""
    found: dict[str, sp.Expr] = {"time": CONTACT.t}
    if system.slip_position is not None:
        found["position"] = CONTACT.s
    found |= {"velocity": CONTACT.v, "acceleration": CONTACT.a}
    if load_varies(system):
        found["normal_force"] = CONTACT.N
    for c in system.moving:
        if system.jacobian[c.name] == 0:  # a motion across the slip
            found |= dict(zip(c.signals, c.symbols, strict=True))
    return found | applied(system)


def places(remainder: Remainder, samples: np.ndarray) -> dict[str, float]:
    """Hidden parameters that spread the bumps over the range of the variable's samples, shape (n,)."""
    low, high = np.quantile(samples, [0.002, 0.998])  # single samples far out would stretch it
    first, step = remainder.place
    return {first: float(low), step: float(max(high - low, 1e-9) / (BUMPS - 1))}


def signal_symbols(system: System) -> dict[str, sp.Symbol]:
    """Measured signal -> its symbol in the equations of motion."""
    motion = {n: s for c in system.moving for n, s in zip(c.signals, c.symbols, strict=True)}
    return motion | {item.name: item.symbol for item in system.inputs}


def samples(system: System, run: Simulation, expression: sp.Expr) -> np.ndarray:
    """An expression in a contact's variables and measured signals at the samples of a simulation, shape (n,).

    ``system`` is as the contact sees it.
    """
    run = run.at(system.contacts[0].name)
    known = {CONTACT.t: run.t, CONTACT.v: run.v_slip, CONTACT.N: run.N}
    known |= {s: run.signals.get(n, np.zeros(len(run.t))) for n, s in signal_symbols(system).items()}
    expression = sp.sympify({CONTACT.s: system.slip_position, CONTACT.a: system.a_slip}.get(expression, expression))
    expression = expression.subs({par.symbol: system.values[par.name] for par in system.parameters})
    symbols = sorted(expression.free_symbols, key=str)
    value = sp.lambdify(symbols, expression, "numpy")(*(known[s] for s in symbols))
    return np.broadcast_to(np.asarray(value, dtype=float), run.t.shape).copy()


def scales(system: System, runs: Sequence[Simulation]) -> dict[str, Scales]:
    """What hidden parameters are tried relative to, by contact; that of the first, too, for what is at none.

    See :func:`frictionpinn.physics.scan.data_scales`.
    """

    def of(view: System) -> Scales:
        own, has_position = [run.at(view.contacts[0].name) for run in runs], view.slip_position is not None
        position = [samples(view, run, CONTACT.s) if has_position else np.cumsum(run.v_slip) for run in own]
        return data_scales([run.t for run in own], position, [run.v_slip for run in own], [run.N for run in own])

    found = {contact.name: of(system.at(contact.name)) for contact in system.contacts}
    return {"": next(iter(found.values()))} | found


def ranges(system: System, remainders: Sequence[Remainder], runs: Sequence[Simulation]) -> dict[str, np.ndarray]:
    """Samples of each remainder's variable, all trials together."""
    views = {r.variable: system.at(r.contact) for r in remainders}
    return {r.variable: np.concatenate([samples(views[r.variable], run, r.symbol) for run in runs]) for r in remainders}


def impossible(
    bench: Bench,
    candidate: Candidate,
    values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """Why an effect cannot be what is missing, by what a refit made of it; empty where it can.

    * the 95 % interval holds zero (of several strengths all do), has no width (numerically degenerate), or is unknown;
    * a share or a mass at the lower limit where nothing is left: a mass, a sensor's scale, friction of one direction;
    * an inertia that makes the moving mass negative;
    * a delay longer than a period of the fastest motion: another cycle would do as well;
    * a wavelength above the stroke: no period was seen.

    Args:
        values: all parameters of the refit, SI units.
        ci95: 95 % intervals of the strengths; None: not known yet.
    """
    table = {par.name: par for par in bench.tested.parameters}
    for name in (*candidate.strengths, *candidate.hidden):
        value, low = values[name], table[name].low
        if not np.isfinite(value):
            return f"{name} is no number"
        if np.isfinite(low) and low < 0 and value <= LIMIT * low:
            return f"{name} at its limit, {low:.3g} {table[name].unit}, where nothing is left of what it changes"
        if name.endswith("wavelength") and value > (stroke := bench.sizes.at(name).scales["stroke"][1]):
            return f"{name} of {value:.3g} above the stroke of {stroke:.3g}: no period was seen"
    effect = next(e for e in bench.tested.effects if e.name == candidate.effect)
    delays = {name for signs in effect.delays(bench.tested.system, bench.tested.law).values() for name in signs}
    late = max((n for n in candidate.strengths if n in delays), key=lambda n: abs(values[n]), default=None)
    if late and abs(values[late]) > (period := fastest_period(bench)):
        return f"{late} of {values[late]:.3g} s, longer than a period of the fastest motion, {period:.3g} s"
    kind, _, contact = candidate.effect.partition("@")
    if kind == "inertia" and (own := values[candidate.strengths[0]]) < 0 and own <= -moving_mass(bench, contact):
        return f"inertia of {own:.3g} makes the moving mass negative"
    intervals = [] if ci95 is None else [ci95[name] for name in candidate.strengths]
    if not np.isfinite(intervals).all():
        return "these data do not tell how large it is"
    if any(low == high for low, high in intervals):
        return "its 95 % interval has no width: numerically degenerate"
    if intervals and all(low <= 0 <= high for low, high in intervals):
        return f"its 95 % interval holds zero ({'; '.join(f'{low:.3g} to {high:.3g}' for low, high in intervals)})"
    return ""


def fastest_period(bench: Bench) -> float:
    """Period of the fastest motion, s: of each trial the frequency below which most of the slip velocity's power lies,
    the largest of all trials."""
    fastest = 0.0
    for run in bench.simulate(bench.base):
        t = np.linspace(run.t[0], run.t[-1], len(run.t))
        for v_slip in (run.at(name).v_slip for name in run.contacts):
            power = np.abs(np.fft.rfft(np.interp(t, run.t, v_slip))[1:]) ** 2
            if power.sum() > 0:
                k = int(np.searchsorted(np.cumsum(power), POWER * power.sum()))
                fastest = max(fastest, (k + 1) / float(t[-1] - t[0]))
    return 1 / fastest if fastest > 0 else np.inf


def moving_mass(bench: Bench, contact: str = "") -> float:
    """Least force per slip acceleration of a contact along the motion, in its unit of mass or inertia.

    Infinite where the equation of motion has none.
    """
    system = bench.mechanism.system.at(contact)
    slipping = [c for c in system.free if system.jacobian[c.name] != 0]
    if system.massless or len(slipping) != 1:
        return np.inf
    (c,) = slipping
    slope = sp.diff(system.residual(c), c.symbols[2]) / system.jacobian[c.name] ** 2
    return min(float(samples(system, run, slope).min()) for run in bench.simulate(bench.base))
