"""The report of a robot's diagnosis: one page, a figure before the table of joints."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template
from matplotlib.figure import Figure

from ..diagnose.verdict import NOTHING, UNEXPLAINED
from ..evaluate.picture import save_png
from ..evaluate.style import INK
from ..physics.base import at_contact, plain_name
from ..robots.balance import Model
from ..robots.candidates import Term
from ..robots.diagnose import ROBOT, Rest, RobotDiagnosis
from ..robots.identify import joint_effect
from ..robots.least_squares import Solution
from ..robots.motion import Prepared
from ..robots.rounds import Accepted
from ..show import LOOKS, readable_unit
from .words import number, span

KINDS = {"force": "a torque", "friction": "friction"}
NAMED = 3  # parameters by name in a sentence


def headline(d: RobotDiagnosis) -> str:
    """What was found, in a few sentences."""
    by_effect: dict[str, list[str]] = {}
    for a in d.accepted:
        kinds = dict.fromkeys([a.term.kind, *(name.partition("@")[0].partition(" ")[0] for name in a.alike)])
        by_effect.setdefault(" or ".join(kinds), []).append(joint_in(a.term.name).removeprefix("joint_"))
    said = [
        kind.replace("_", " ")
        + (f" in joint{'s' if len(set(j)) > 1 else ''} {', '.join(sorted(set(j)))}" if any(j) else "")
        for kind, j in by_effect.items()
    ]
    sentences = [f"Missing: {'; '.join(said)}." if said else "Nothing is missing that this recording could show."]
    sentences += filter(None, [not_converged(d.fit)])
    for joint, rest in d.rest.items():
        sentences.append(f"{joint.replace('_', ' ').capitalize()}: {left_in_words(rest)}, which no name fits.")
    for name in scored_trials(d):
        before, after = 100 * d.errors[name].mean(axis=1)
        held = "held out" if name in held_names(d) else "fitted"
        sentences.append(f"Mean relative torque error on {name} ({held}): {before:.1f} % before, {after:.1f} % after.")
    return " ".join(sentences)


def not_converged(solution: Solution) -> str:
    """That a search ended before it had settled, and what to do; empty where it had."""
    if solution.converged:
        return ""
    own = [n for n in solution.model.free if n.partition(".")[0] in solution.model.names]
    untold = [n for n in own if not solution.told(n)]
    of = f"what these data do not tell ({', '.join(untold[:NAMED])})" if untold else "what is known otherwise"
    which = (untold or own or ["joint_1.mu_c"])[0]
    return (
        f"The search did not converge, its values and intervals are not final: hold {of} with "
        f"friction.fixed.{which}=..., begin elsewhere with friction.start, or declare simpler laws."
    )


def joint_in(term: str) -> str:
    """The joint in a term's name, ``ripple@joint_3 (force)``; empty where it acts on the robot as a whole."""
    return term.partition("@")[2].partition(" ")[0]


def held_names(d: RobotDiagnosis) -> list[str]:
    """Names of the trials that took no part."""
    return [trial.name for trial in d.held_out]


def scored_trials(d: RobotDiagnosis) -> list[str]:
    """Trials that errors are told of: held out, where there are any."""
    return held_names(d) or list(d.errors)


def left_in_words(rest: Rest) -> str:
    """What is left at a joint."""
    return (
        f"{KINDS[rest.kind]} that depends on {' or '.join(rest.variables[:3])}, {100 * rest.size:.2g} % of its friction"
    )


def unit_of(d: RobotDiagnosis) -> dict[str, str]:
    """Units of the parameters of joints and of effects on the robot."""
    model, units = d.fit.model, {n: u for w in d.fit.model.whole for n, u in w.parameters.items()}
    for k in range(len(model.names)):
        units |= {at_contact(model.names[k], n): u for n, u in model.friction(k).mechanism.units.items()}
    return {n: "" if u == "1" else u for n, u in units.items()}


def effect_in_words(d: RobotDiagnosis, a: Accepted) -> str:
    """An effect with its strengths and their intervals."""
    model = d.fit.model
    units = {n: readable_unit(u) for n, u in unit_of(d).items()}
    values = [
        f"{plain_name(n)} {number(model.values[n], d.fit.interval(n))} {units.get(n, '')}".rstrip()
        + f" [{span(d.fit.interval(n))}]"
        for n in a.term.names(model)
        if n in model.values
    ]
    about = f" ({mass_by_file(d)})" if a.term.name == "payload" and mass_by_file(d) else ""
    at = f" of {joint_in(a.term.name)}" if a.term.joint is None and joint_in(a.term.name) else ""
    return f"{a.term.name.partition('@')[0]}{at}: {', '.join(values)}{about}"


def alike_in_words(accepted: Sequence[Accepted]) -> list[str]:
    """What explains about as much as effects that were added."""
    return [f"{a.term.name.partition('@')[0]} or {', '.join(a.alike)}" for a in accepted if a.alike]


def mass_by_file(d: RobotDiagnosis) -> str:
    """A payload's mass where the robot file's masses, not the motors' gains, are taken as the measure.

    Gains that are all too large by a share make every estimated mass too large by it. The joint with the largest
    gravity load shows by how much the arm itself seems heavier than its file says.
    """
    model, trials = d.fit.model, d.fit.trials
    mass = model.values.get("payload.mass", 0.0)
    if not mass or not model.robot.inertial[::10].sum() > 0:
        return ""
    down = model.robot.model.gravity.linear
    own, file = [], []
    for trial in trials:
        Y = model.robot.gravity_regressor(trial.q, down)
        own.append(model.base.reduced(Y) @ model.beta)
        file.append(Y @ model.robot.inertial)
    a, b = np.concatenate(own), np.concatenate(file)
    k = int(np.argmax(np.sum(b**2, axis=0)))
    factor = float(a[:, k] @ b[:, k] / (b[:, k] @ b[:, k]))
    return (
        f"at the gains as given, by which {model.names[k]} carries {factor:.3g} times the arm of the robot file; "
        f"{mass / factor:.4g} kg if that is the gains' error"
    )


def rows(d: RobotDiagnosis) -> list[dict[str, Any]]:
    """The table: of each joint, and of the robot as a whole, its verdict and effects, errors and what is left."""
    shown, made = scored_trials(d), []
    for k, joint in enumerate(d.fit.model.names):
        rest = d.rest.get(joint) or d.trifles.get(joint)
        left = (
            "" if rest is None else left_in_words(rest) + ("" if joint in d.rest else " (too small, or not confirmed)")
        )
        made.append(
            {
                "joint": joint,
                "name": d.fit.model.robot.joints[k],
                "verdict": d.verdicts[joint],
                "effects": [effect_in_words(d, a) for a in d.at(k)],
                "alike": alike_in_words(d.at(k)),
                "errors": {name: [float(100 * e) for e in d.errors[name][:, k]] for name in shown},
                "left": left,
            }
        )
    if d.at(None):
        mean = {name: [float(100 * e) for e in d.errors[name].mean(axis=1)] for name in shown}
        made.append(
            {
                "joint": ROBOT,
                "name": "as a whole",
                "verdict": d.verdicts[ROBOT],
                "alike": alike_in_words(d.at(None)),
                "effects": [effect_in_words(d, a) for a in d.at(None)],
                "errors": mean,
                "left": "",
            }
        )
    return made


def in_text(d: RobotDiagnosis) -> list[str]:
    """The same as lines."""
    lines = [headline(d)]
    for row in rows(d):
        errors = "; ".join(f"{name} {old:.1f} -> {new:.1f} %" for name, (old, new) in row["errors"].items())
        lines.append(f"  {row['joint']} ({row['name']}): {row['verdict']}; {errors}")
        lines += [f"    {text}" for text in row["effects"]]
        lines += [f"    hardly told apart: {text}" for text in row["alike"]]
        lines += [f"    left: {row['left']}"] if row["left"] else []
    return lines


def said(term: Term) -> str:
    """What an effect is and where it occurs."""
    if term.whole is not None:
        return term.whole.said()
    told = joint_effect(term.kind).said()
    occurs = f"Occurs: {told['occurs']}" if told.get("occurs") else ""
    return " ".join(filter(None, [told.get("equation", ""), occurs])).replace("``", "")


def draw(folder: Path, d: RobotDiagnosis) -> list[Path]:
    """Write the figures as PNG; return the files in reading order."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {"errors": error_figure(d), "torques": torque_figure(d)}
    if d.rest:
        drawn["left"] = left_figure(d)
    for name, figure in drawn.items():
        save_png(figure, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in drawn]


def error_figure(d: RobotDiagnosis) -> Figure:
    """Relative torque error of each joint, before and after, of every trial that errors are told of."""
    names = scored_trials(d)[:3]
    figure = Figure(figsize=(8, 0.6 + 1.9 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    places = np.arange(len(d.fit.model.names))
    for ax, name in zip(axes, names, strict=True):
        for shift, row, label, color in ((-0.2, 0, "declared model", "baseline"), (0.2, 1, "augmented model", "model")):
            values = 100 * d.errors[name][row]
            bars = ax.bar(places + shift, values, 0.38, color=INK[color], label=label)
            ax.bar_label(bars, fmt="%.1f", fontsize=8, padding=1)
        ax.set_xticks(places, [n.replace("_", " ") for n in d.fit.model.names])
        held = "held out" if name in held_names(d) else "fitted"
        ax.set(
            ylabel="torque error (%)",
            title=f"{name}, {held}: mean {100 * d.errors[name][0].mean():.1f} % before, "
            f"{100 * d.errors[name][1].mean():.1f} % after",
        )
        ax.title.set_fontsize(10)
        ax.margins(y=0.15)
    figure.legend(*axes[0].get_legend_handles_labels(), frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    return figure


def torque_figure(d: RobotDiagnosis) -> Figure:
    """Torque error of each joint over time, before and after, on the first trial that errors are told of."""
    trial, labels = (*d.held_out, *d.fit.trials)[0], ("error of the declared model", "error of the augmented model")
    models = (d.declared.model, d.fit.model)
    lines = {label: model.recorded(trial) - trial.tau for label, model in zip(labels, models, strict=True)}
    return torques_over_time(d.fit.model, trial, lines)


def torques_over_time(model: Model, trial: Prepared, lines: Mapping[str, np.ndarray]) -> Figure:
    """Two models' torques less measured ones over time, a panel for each joint, the first model's in grey.

    Args:
        lines: label -> errors at the compared samples, N m, shape (m, joints).
    """
    columns = 2
    count = -(-len(model.names) // columns)
    figure = Figure(figsize=(9, 0.8 + 1.5 * count), layout="constrained")
    axes = figure.subplots(count, columns, sharex=True, squeeze=False).ravel()
    for k, (ax, joint) in enumerate(zip(axes, model.names, strict=False)):
        for (label, off), color in zip(lines.items(), ("baseline", "model"), strict=True):
            ax.plot(trial.compared, off[:, k], color=INK[color], lw=0.9, label=label)
        reach = 1.6 * float(np.quantile(np.abs(next(iter(lines.values()))[:, k]), 0.999))
        ax.set_ylim(-reach, reach)
        ax.set_ylabel(f"{joint.replace('_', ' ')} ({'N m' if model.robot.turns[k] else 'N'})", fontsize=8)
        ax.tick_params(labelsize=8)
        ax.margins(x=0.01)
    for ax in axes[len(model.names) :]:
        ax.set_visible(False)
    for ax in axes[max(len(model.names) - columns, 0) : len(model.names)]:
        ax.set_xlabel("time (s)")
        ax.tick_params(labelbottom=True)  # a shared axis has its figures below the last row alone
    figure.suptitle(f"model less measurement, {trial.name}", fontsize=10)
    figure.legend(*axes[0].get_legend_handles_labels(), frameon=False, fontsize=8, loc="outside lower center", ncols=3)
    return figure


def left_figure(d: RobotDiagnosis) -> Figure:
    """What no name fits, over the variable that explains most of it."""
    figure = Figure(figsize=(8, 0.4 + 2.2 * len(d.rest)), layout="constrained")
    for ax, (joint, rest) in zip(figure.subplots(len(d.rest), 1, squeeze=False)[:, 0], d.rest.items(), strict=True):
        ax.plot(rest.x, rest.y, color=INK["model"])
        ax.axhline(0.0, color=INK["reference"], lw=0.8)
        force = "N m" if d.fit.model.robot.turns[d.fit.model.names.index(joint)] else "N"
        ax.set(xlabel=rest.variables[0], ylabel=f"{joint.replace('_', ' ')} ({force})", title=left_in_words(rest))
        ax.title.set_fontsize(10)
    return figure


def write_page(path: Path, result: Mapping[str, Any], figures: Sequence[Path]) -> None:
    """Write the page, from ``robot.html`` beside this file.

    Args:
        result: as in ``result.json``; ``handed_on`` as in ``export.json`` where the robot was handed on.
        figures: PNG files, embedded under their names.
    """
    images = {p.stem: base64.b64encode(p.read_bytes()).decode() for p in figures}
    page = Template(Path(__file__).with_name("robot.html").read_text(encoding="utf-8"))
    refused: dict[str, list[str]] = {}
    for item in result["refused"]:
        refused.setdefault(item["why"], []).append(item["name"])
    text = page.render(
        r=result,
        headline=result["headline"],
        images=images,
        refused=refused,
        looks=LOOKS,
        number=number,
        span=span,
        unit=readable_unit,
        nothing=NOTHING,
        unexplained=UNEXPLAINED,
    )
    path.write_text(text, encoding="utf-8")
