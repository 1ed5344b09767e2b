"""The gallery of effects: equation, residual and experiment of each, from the effects' own definitions.

An effect that is added to the package appears by itself: the first system in motion and the simplest law with which it
can act are taken, its hidden parameters from the range that a diagnosis scans, and its strength such that it changes
what is measured by a tenth. What is drawn is what the declared model leaves when it is fitted to that recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy as sp
from beds import BEDS, LAWS_IN_ORDER, NOISE, Bed, fitted, scales_of
from matplotlib.figure import Figure
from reference import SHORT, latex, quoted, table

from frictionpinn.data.recording import Recording
from frictionpinn.evaluate.style import INK
from frictionpinn.physics import EFFECTS, Effect
from frictionpinn.physics.base import CONTACT, SESSION, TIME, TRIAL
from frictionpinn.physics.friction import CONTACT_LAWS
from frictionpinn.physics.mechanism import REQUIRED, Mechanism
from frictionpinn.show import readable_unit

CHANGE = 0.1  # of what is measured, rms: the strength of a shown effect
# Where values from the scan make a poor picture: lengths and frequencies that the eye can follow.
CHOSEN = {"ripple_wavelength": 0.02, "vibration_frequency": 4.0, "dwell_time": 0.1}
GROUP = {"trial_level": "2"}
ENOUGH = 0.4  # share of what is left that a variable has to explain
MIDDLE = "time (s) of trial"
INTRO = """# Gallery of effects

What a diagnosis tries when a declared model leaves something: one section for each effect, with the equation from its
definition, what the declared model leaves where it acts, and the experiment that shows it. In every figure the effect
changes what is measured by {change:.0f} %, on average, and noise is {noise:.0f} % (the band: two standard deviations);
the declared law was fitted first, so that its parameters have already taken what they can. Left over time, trials one
after another; right over the variable that tells most of it, by the direction of slip.
"""


@dataclass(frozen=True)
class Shown:
    """An effect at work: where, with which law and parameters, and what the declared model leaves, by trial."""

    effect: Effect
    bed: Bed
    mechanism: Mechanism
    values: Mapping[str, float]
    strengths: tuple[str, ...]
    recording: Recording
    residuals: list[np.ndarray]
    sigma: float


def write(folder: Path) -> None:
    """Write the page and its figures below a folder."""
    parts, rows = [INTRO.format(change=100 * CHANGE, noise=100 * NOISE)], []
    (folder / "effects").mkdir()
    for name in EFFECTS:
        shown = at_work(name)
        figure(shown).savefig(folder / "effects" / f"{name}.png", dpi=130)
        rows.append((f"[{name}](#{name})", quoted(shown.effect.said()["occurs"])))
        parts.append(section(shown))
    text = "\n\n".join([parts[0], table(("effect", "occurs"), rows), *parts[1:]])
    (folder / "effects.md").write_text(text + "\n", encoding="utf-8")


def at_work(name: str) -> Shown:
    """An effect where it can act, with a strength that is seen, and what the declared model leaves then."""
    bed, law, beside = place_of(name)
    truth, plain = bed.truth(law), bed.mechanism(law, beside)
    truth |= {par.name: 1.0 for effect in plain.effects for par in effect.parameters_on(plain.system, plain.law)
              if not par.hidden}  # fmt: skip
    before = bed.record(plain, truth)
    mechanism = bed.mechanism(law, (*beside, name))
    effect = next(item for item in mechanism.effects if item.name == name)
    groups = effect.groups(mechanism.system, mechanism.law)
    group = groups.get(GROUP.get(name, ""), list(groups.values())[-1 if name.startswith("sensor") else 0])[:1]
    values = truth | hidden_values(mechanism, before)
    own = strength_of(bed, mechanism, values, group[0], before)
    recording = bed.record(mechanism, values | {group[0]: own})
    sigma = NOISE * float(np.std(np.concatenate([trial.signals[bed.shown] for trial in recording.trials])))
    rng = np.random.default_rng(0)
    noisy = [trial.with_signals(**{bed.shown: trial.signals[bed.shown] + sigma * rng.standard_normal(len(trial))})
             for trial in recording.trials]  # fmt: skip
    recording = Recording(tuple(noisy), recording.units)
    left = fitted(
        plain, recording, bed.truth(law), {n: v for n, v in values.items() if n not in bed.truth(law)}, bed.shown
    )
    return Shown(effect, bed, mechanism, values | {group[0]: own}, group, recording, left, sigma)


def place_of(name: str) -> tuple[Bed, str, tuple[str, ...]]:
    """The first bed and law with which an effect can act, and what it needs beside it."""
    kind = EFFECTS[name]()
    for beside in ((), ("presliding",)):
        for bed in BEDS:
            for law in LAWS_IN_ORDER:
                if kind.applies(bed.mechanism(law).system, CONTACT_LAWS[law](), beside):
                    return bed, law, beside
    raise LookupError(f"effect {name} can act on none of the gallery's systems: add one to beds.py")


def hidden_values(mechanism: Mechanism, recording: Recording) -> dict[str, float]:
    """Hidden parameters of the effects: in the upper part of what a diagnosis would scan here, else their defaults."""
    scales, found = scales_of(recording), {}
    for effect in mechanism.effects:
        for par in effect.parameters_on(mechanism.system, mechanism.law):
            if par.hidden and par.name not in CHOSEN and par.scan is not None:
                tried = par.scan.values(scales)
                found[par.name] = float(tried[2 * len(tried) // 3])
            elif par.hidden:
                found[par.name] = CHOSEN.get(par.name, par.value)
    return found


def strength_of(bed: Bed, mechanism: Mechanism, values: Mapping[str, float], name: str, before: Recording) -> float:
    """The strength at which the shown signal changes by CHANGE of its own size, within the parameter's limits."""
    par = next(par for par in mechanism.parameters if par.name == name)
    old = np.concatenate([trial.signals[bed.shown] for trial in before.trials])
    wanted = CHANGE * float(np.mean(np.abs(old - np.mean(old))))
    size = 1e-3 * (1.0 if par.scan is None else float(par.scan.values(scales_of(before))[-1]))
    for _ in range(12):
        made = bed.record(mechanism, values | {name: size})
        new = np.concatenate([trial.signals[bed.shown] for trial in made.trials])
        change = float(np.mean(np.abs(new - old)))
        if abs(change / wanted - 1) < 0.1 or size >= par.high:
            break
        size = min(size * float(np.clip(wanted / max(change, 1e-12), 0.02, 30.0)), par.high)
    return size


def figure(shown: Shown) -> Figure:
    """What the declared model leaves, over time and over the variable that tells most of it."""
    name, unit = shown.bed.shown, readable_unit(shown.recording.units[shown.bed.shown])
    drawn = Figure(figsize=(9, 3.1), layout="constrained")
    left, right = drawn.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    offset, ends = 0.0, []
    for trial, residual in zip(shown.recording.trials, shown.residuals, strict=True):
        left.plot(offset + trial.t, residual, ".", ms=2.2, color=INK["model"])
        offset += float(trial.t[-1] + trial.t[1] - trial.t[0])
        ends.append(offset)
    for end in ends[:-1]:
        left.axvline(end, color=INK["baseline"], lw=0.8, ls=":")
    for axes in (left, right):
        axes.axhspan(-2 * shown.sigma, 2 * shown.sigma, color=INK["band"], zorder=0)
        axes.axhline(0, color=INK["reference"], lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    what = {"force": "force", "tau": "torque", "a": "acceleration"}.get(name, name)
    left.set(xlabel="time (s), dotted: the next trial", ylabel=f"{what}, model minus\nmeasurement ({unit})")
    left.margins(x=0.01)
    y = np.concatenate(shown.residuals)
    low, high = np.percentile(y, (1.5, 98.5))
    room = max(0.12 * (high - low), shown.sigma)
    left.set_ylim(min(low - room, -3 * shown.sigma), max(high + room, 3 * shown.sigma))  # single samples may lie beyond
    label, x, forwards = telling(shown)
    for chosen, color, words in ((forwards, INK["observer"], "forwards"), (~forwards, INK["simulator"], "backwards")):
        right.plot(x[chosen], y[chosen], ".", ms=2.2, color=color, label=words)
    if label.startswith(MIDDLE):
        right.set_xlim(np.nanmin(x), np.nanmax(x))
    right.set_xlabel(label)
    right.legend(frameon=False, fontsize=8, markerscale=4, loc="best", handletextpad=0.1)
    return drawn


def telling(shown: Shown) -> tuple[str, np.ndarray, np.ndarray]:
    """Label and samples of the variable that explains most of what is left, and which samples slip forwards.

    Where no variable explains much, the time of the trial in the middle.
    """
    trials, y = shown.recording.trials, np.concatenate(shown.residuals)
    length, place, sessions = shown.mechanism.system.slip_unit, 0.0, []
    for trial in trials:
        sessions.append(place + trial.t)
        place += float(trial.t[-1] + trial.t[1] - trial.t[0])

    def joined(of: str) -> np.ndarray:
        return np.concatenate([np.broadcast_to((t.truth | t.signals)[of], t.t.shape) for t in trials])

    variables = {f"slip velocity ({length}/s)": joined("v_slip"), "normal force (N)": joined("normal_force")}
    names = {"x": "position", "theta": "angle", "a": "acceleration", "alpha": "angular acceleration", "y": "height"}
    for signal in trials[0].signals:
        if signal not in (shown.bed.shown, "v", "omega"):
            variables[f"{names.get(signal, signal)} ({readable_unit(shown.recording.units[signal])})"] = joined(signal)
    variables["time of the session (s)"] = np.concatenate(sessions)
    forwards = joined("v_slip") > 0
    told = {label: explained(x, y, forwards) for label, x in variables.items()}
    told["time of the session (s)"] *= 0.9  # a motion that repeats follows it, too
    told["normal force (N)"] *= 1.02  # rather than the motion that makes it
    best = max(told, key=told.__getitem__)
    if told[best] > ENOUGH:
        return best, variables[best], forwards
    middle = len(trials) // 2
    alone = [t.t if k == middle else np.full(len(t), np.nan) for k, t in enumerate(trials)]
    return f"{MIDDLE} {trials[middle].name}", np.concatenate(alone), forwards


def explained(x: np.ndarray, y: np.ndarray, forwards: np.ndarray, bins: int = 24) -> float:
    """Share of the variance of y that the means over bins of x, by direction, explain; bins hold equally many."""
    if np.ptp(x) == 0:
        return 0.0
    rest = 0.0
    for chosen in (forwards, ~forwards):
        order = np.argsort(x[chosen], kind="stable")
        rest += sum(np.var(part) * len(part) for part in np.array_split(y[chosen][order], bins) if len(part))
    return float(1 - rest / (np.var(y) * len(y)))


def section(shown: Shown) -> str:
    """An effect's section: figure, equation, where it occurs, the experiment, parameters."""
    name, said, mechanism = shown.effect.name, shown.effect.said(), shown.mechanism
    rows = [(f"`{p.name}`", readable_unit(mechanism.units[p.name]), p.text, f"{shown.values[p.name]:.3g}")
            for p in shown.effect.make_parameters(mechanism.system, mechanism.law)
            if p.name in shown.values]  # fmt: skip
    beside = [effect.name for effect in mechanism.effects if effect.name != name]
    law = f"`{mechanism.law.name}`" + (f" with `{beside[0]}`" if beside else "")
    equations = "\n\n".join(f"$$\n{text}\n$$" for text in equations_of(shown))
    return "\n\n".join([
        f"## {name} {{ #{name} }}",
        f"![what the declared model leaves where {name} acts](effects/{name}.png)",
        f"{mechanism.system.title.capitalize()}, declared as {law}.",
        equations,
        quoted(said["equation"]),
        f"**Occurs** {quoted(said['occurs'])}",
        f"**Experiment:** {quoted(said['experiment'])}",
        table(("parameter", "unit", "", "in the figure"), rows),
    ])  # fmt: skip


def equations_of(shown: Shown) -> Iterator[str]:
    """LaTeX of what the effect does, from its hooks: to load, force, bristle, states, symbols, sensors and delays."""
    effect, mechanism = shown.effect, shown.mechanism
    system, law, p = mechanism.system, mechanism.law, mechanism.p
    names = _names(mechanism)
    if len(effect.groups(system, law)) > 1:  # of several that are tested alone, the one in the figure
        names |= {sp.Symbol(par.name, real=True): sp.Integer(0) for par in effect.parameters_on(system, law)
                  if not par.hidden and par.name not in shown.strengths}  # fmt: skip

    def told(left: str, side: sp.Expr) -> str:
        return latex(left, sp.sympify(side).xreplace(names))

    load = effect.load(CONTACT.N, CONTACT, p)
    if sp.sympify(load).xreplace(names) != names[CONTACT.N]:
        yield told(upright("N", "law"), load)
    if (force := effect.force(CONTACT, p, law)) != 0:
        text = told("", force).removeprefix(" =").strip()
        yield f"F = {upright('F', 'law')} + {text}"
    if (bent := effect.deflection(CONTACT.z, p)) != CONTACT.z:
        yield told(upright("z", "law"), bent)
    if effect.memory:
        yield told(r"\dot{z}", effect.bristle_rate(CONTACT, p, law))
    for state, rate in zip(effect.states, effect.state_rates(CONTACT, p), strict=True):
        yield told(rf"\dot{{\mathrm{{{state.name}}}}}", rate)
    for symbol, other in effect.replace(system, law, p).items():
        if sp.sympify(other).xreplace(names) != names.get(symbol, symbol):
            yield told(upright(written(names.get(symbol, symbol)), "acting"), other)
    for signal, symbol in mechanism.predictions.items():
        if sp.sympify(other := effect.sensor(system, signal, symbol, p)).xreplace(names) != names.get(symbol, symbol):
            yield told(upright(written(sp.Symbol(signal)), "measured"), other)
    for signal, terms in effect.delays(system, law).items():
        late = [sign * sp.Symbol(par, real=True) for par, sign in terms.items() if par in shown.strengths]
        if late:
            what = upright(written(sp.Symbol(signal)), "measured" if signal in mechanism.predictions else "acting")
            moment = sp.Symbol("t") - sum(sp.Integer(round(x.as_coeff_Mul()[0])) * x.as_coeff_Mul()[1] for x in late)
            text = told("", moment).removeprefix(" =").strip()
            yield f"{what}(t) = {written(sp.Symbol(signal))}({text})"


def upright(what: str, index: str) -> str:
    """A symbol with a word as its index."""
    return rf"{what}_{{\mathrm{{{index}}}}}"


def written(symbol: sp.Symbol) -> str:
    """A symbol in LaTeX as equations write it."""
    return latex("", symbol).removeprefix(" =").strip()


def _names(mechanism: Mechanism) -> dict[sp.Symbol, sp.Expr]:
    """Symbols of the equations -> as a reader knows them: signals by their names, the contact in short."""
    names = {TIME: sp.Symbol("t"), SESSION: sp.Symbol("t_session"), TRIAL: sp.Symbol("trial"),
             CONTACT.s: sp.Symbol("s"), CONTACT.a: sp.Symbol("a"), REQUIRED: sp.Symbol("F"), **SHORT}  # fmt: skip
    for coordinate in mechanism.system.moving:
        names |= {symbol: sp.Symbol(name) for symbol, name in zip(coordinate.symbols, coordinate.signals, strict=True)}
    return names | {item.symbol: sp.Symbol(item.name) for item in mechanism.system.inputs}
