"""The whole chain of an axis: a recording with the PID alone, what it lacks, a compensator, a recording again."""

from __future__ import annotations

import html
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..control import Compensator, Gains, Loop, Plant, close, reference, tuned
from ..control.build import build_compensator
from ..control.compensator import check_axis, completed, dry_friction
from ..control.pid import delay_margin, loop_dead_time
from ..control.record import recorded
from ..control.recursions import inertia
from ..control.references import Reference, stroke
from ..data.recording import Recording
from ..errors import UserError, choose
from ..evaluate.style import INK
from ..online.check import finite
from ..physics import LAWS
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism
from ..show import page, picture, png, readable_unit
from .build import Config, build_system
from .manifest import write_json
from .provenance import commit, versions

log = logging.getLogger(__name__)
SKIPPED = 1 / 3  # of a motion, in which a compensator that adapts finds its parameters


def compensate(cfg: Config, folder: Path) -> dict[str, Any]:
    """Record, diagnose, identify, compensate, record again; write page, result and the compensator as C.

    Args:
        cfg: resolved conf/compensate.yaml.
        folder: of this run.

    Returns:
        What stands in ``result.json``: verdict, parameters, and for every motion the rms tracking error before and
        after, in the unit of position.

    Raises:
        UserError: anything that the user can mend.
    """
    system = build_system(cfg["system"])
    declared = Mechanism(system, choose(cfg["friction"]["name"], LAWS, "friction")())
    check_axis(declared)
    plant, loop = _plant(cfg, declared), cfg["loop"]
    own = {"interval": loop["interval"], "delay": loop["delay"]}
    # before minutes are spent on it: motions and compensator are possible, whatever the parameters will be
    motions = _motions(cfg["follow"]["motions"], cfg["follow"]["duration"], cfg["scale"], "follow", "motions")
    trials = _motions(cfg["record"]["trials"], cfg["record"]["duration"], cfg["scale"], "record", "trials")
    reach = stroke([path for _, path in motions], cfg["follow"]["duration"])
    sensed = own | {"resolution": cfg["machine"]["resolution"], "stroke": reach}
    build_compensator(cfg["control"], declared, completed(declared, {}), **sensed)
    gains = _gains(plant, declared, loop)
    check_machine(plant, gains, loop, reach)
    log.info(f"PID: kp {gains.kp:.4g}, ki {gains.ki:.4g}, kd {gains.kd:.4g}")
    alone = {
        str(k + 1): close(plant, gains, path, cfg["record"]["duration"], None, (declared, {}), **own)
        for k, (_, path) in enumerate(trials)
    }
    recording = recorded(alone, declared, loop["delay"], cfg["record"]["rate_hz"])
    mechanism, values, verdict = identified(declared, recording, folder, **cfg["diagnose"])
    helper = build_compensator(cfg["control"], mechanism, values, **sensed)
    files: list[str] = []
    folder.mkdir(parents=True, exist_ok=True)
    if helper is not None:
        from ..export.compensator import write_compensator_c

        files = write_compensator_c(folder, helper)
    runs = []
    for name, path in motions:
        duration, model = cfg["follow"]["duration"], (mechanism, values)
        before = close(plant, gains, path, duration, None, (declared, {}), **own)
        runs.append((name, before, close(plant, gains, path, duration, helper, model, **own)))
    result = {
        "verdict": verdict,
        "mechanism": mechanism.name,
        "compensated": None if helper is None else helper.mechanism.name,
        "parameters": values,
        "control": cfg["control"]["name"],
        "unit": declared.free[0].units[0],
        "motions": {name: {"before": _rms(first), "after": _rms(second)} for name, first, second in runs},
        "files": files,
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    write_json(folder / "result.json", result)
    limited = _limited(runs, plant)
    (folder / "report.html").write_text(_page(result, runs, plant, limited), encoding="utf-8")
    for name, row in result["motions"].items():
        log.info(f"{name}: rms tracking error {_told(row['before'], result['unit'])} before, "
                 f"{_told(row['after'], result['unit'])} after, {_lower(row)}")  # fmt: skip
    if limited:
        log.warning(limited)
    log.info(f"report.html, result.json {' '.join(files)} are in {folder}")
    return result


def _motions(
    items: Sequence[Mapping[str, Any]] | None, duration: float, scale: float, part: str, key: str
) -> list[tuple[str, Reference]]:
    """Motions of the configuration, with their names; every one lasts long enough to reverse."""
    if not (finite(scale) and scale > 0):
        raise UserError("impossible value", where="scale", received=scale, allowed="a number above 0")
    where, allowed = f"{part}.{key}", "name, amplitude (unit of position) and period (s); phase (rad) of a sine"
    if not items:
        raise UserError("no motions", where=where, received=items, allowed=f"a list of motions, each with {allowed}")
    for item in items:
        given = set(item) if isinstance(item, Mapping) else set()
        needed = {"name", "amplitude", "period"}
        if not needed <= given <= needed | ({"phase"} if given and item.get("name") == "sine" else set()):
            raise UserError("no motion", where=where, received=item, allowed=allowed)
        for name in ("amplitude", "period"):
            if not finite(item[name]):
                raise UserError("no number", where=f"{where}.{name}", received=item[name], allowed="a number above 0")
    found = [(str(i["name"]), reference(**{**i, "amplitude": scale * i["amplitude"]})) for i in items]
    least = max(item["period"] for item in items) / 2
    if not (isinstance(duration, int | float) and least <= duration < float("inf")):
        raise UserError("motions that never reverse", where=f"{part}.duration", received=duration,
                        allowed=f"{least:g} s or more, half of the longest period")  # fmt: skip
    return found


def _plant(cfg: Config, declared: Mechanism) -> Plant:
    machine, simulate = cfg["machine"], cfg["system"]["simulate"]
    law = choose(simulate["friction"], LAWS, "system.simulate.friction")
    tables = machine["effects"] or {}
    if not isinstance(tables, Mapping):
        raise UserError("no table of effects", where="machine.effects", received=tables,
                        allowed="values by effect, {asymmetry: {asymmetry: 0.1}}")  # fmt: skip
    effects: tuple[str | Effect, ...] = tuple(tables)
    true = Mechanism(declared.system, law(), effects)  # type: ignore[arg-type]
    truth = dict(simulate["truth"]) | {k: v for table in tables.values() for k, v in (table or {}).items()}
    true.check_names(truth, "machine")
    for key in ("resolution", "delay", "limit"):
        if not isinstance(machine[key], int | float):
            raise UserError("no number", where=f"machine.{key}", received=machine[key], allowed="a number, SI units")
    return Plant(true, truth, machine["resolution"], machine["delay"], machine["limit"])


def _gains(plant: Plant, declared: Mechanism, loop: Mapping[str, float]) -> Gains:
    """The PID, from the declared inertia and the delay alone."""
    probe = Compensator(declared, completed(declared, {}))
    m = inertia(probe.plan.newton, probe.plan.p, probe.plan.sizes)
    dead_time = loop_dead_time(loop["delay"], loop["interval"])
    return tuned(m, dead_time, loop["sensitivity"], limit=plant.limit, dead=2 * plant.resolution)


def check_machine(plant: Plant, gains: Gains, loop: Mapping[str, float], reach: tuple[float, float]) -> None:
    """Raise :class:`UserError` for a machine that the controller cannot move or hold, or does not see moving."""
    unit, force = plant.mechanism.free[0].units[0], plant.mechanism.system.force_unit
    most = loop["delay"] + delay_margin(gains, loop_dead_time(loop["delay"], loop["interval"]))
    if not 0 <= plant.delay <= most:
        raise UserError("delay that the controller does not bear", where="machine.delay", received=plant.delay,
                        allowed=f"0 to {most:.3g} s with loop.delay={loop['delay']:g}",
                        fix="tell the controller of it: loop.delay")  # fmt: skip
    breakaway = dry_friction(plant.mechanism, plant.parameters)
    if not plant.limit > breakaway:
        raise UserError("torque limit below the machine's friction", where="machine.limit", received=plant.limit,
                        allowed=f"above {breakaway:.3g} {readable_unit(force)}, or nothing moves")  # fmt: skip
    span = (reach[1] - reach[0]) / 10
    if not 0 < plant.resolution <= span:
        raise UserError("encoder that does not show the motion", where="machine.resolution", received=plant.resolution,
                        allowed=f"above 0, up to {span:.3g} {readable_unit(unit)}, a tenth of the stroke")  # fmt: skip


def identified(
    declared: Mechanism, recording: Recording, folder: Path, *, effects: Sequence[str] | str, **options: Any
) -> tuple[Mechanism, dict[str, float], str]:
    """What a recording tells of an axis: mechanism with the effects that were found, its parameters, the verdict.

    The motion is taken as measured and the torque predicted: in a closed loop both are, and no error adds up.

    Args:
        declared: the axis as declared.
        recording: see :func:`..control.record.recorded`.
        folder: where ``augmented.yaml`` is written.
        effects: to try; none: the declared law is fitted alone; "all": every one.
        options: of :func:`frictionpinn.diagnose` (free, most, start, ...).
    """
    from ..api.estimates import diagnose, fit
    from ..export.augmented import load_augmented, save_augmented

    system, law = declared.system, declared.law
    values: dict[str, Any] = dict(system.values)
    imposed = Mechanism(type(system)(equations=system.equations, imposed=True, **values), law, declared.effects)
    if not effects:
        found = fit(imposed, recording, check="warn", free=options.get("free"), start=options.get("start"))
        log.info(str(found))
        return declared, values | dict(found.values), "not diagnosed"
    diagnosis = diagnose(imposed, recording, check="warn", effects=effects, **options)
    log.info(str(diagnosis))
    folder.mkdir(parents=True, exist_ok=True)
    save_augmented(folder / "augmented.yaml", diagnosis)
    augmented, known = load_augmented(folder / "augmented.yaml")
    return Mechanism(system, law, augmented.effects), known, diagnosis.verdict


def _late(loop: Loop) -> np.ndarray:
    return loop.t >= SKIPPED * loop.t[-1]


def _rms(loop: Loop) -> float:
    return float(np.sqrt(np.mean(loop.error[_late(loop)] ** 2)))


def _limited(runs: Sequence[tuple[str, Loop, Loop]], plant: Plant) -> str:
    """A sentence on motions for which the machine's torque does not suffice; empty where there is none."""
    held = {name: float(np.mean(np.abs(after.torque[_late(after)]) >= plant.limit)) for name, _, after in runs}
    told = ", ".join(f"{100 * share:.2g} % of {name}" for name, share in held.items() if share > 0)
    limit = f"{plant.limit:g} {readable_unit(plant.mechanism.system.force_unit)}"
    return told and f"The torque is at its limit of {limit} in {told}: no compensation can add to it there."


def _told(value: float, unit: str) -> str:
    factor, small = _scaled(value)
    return f"{factor * value:.3g} {small}{readable_unit(unit)}"


def _scaled(value: float) -> tuple[float, str]:
    """Factor and prefix with which three digits of a value need no exponent."""
    prefixes = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"))
    return next(((factor, small) for factor, small in prefixes if factor * abs(value) >= 0.9995), prefixes[-1])


def _lower(row: Mapping[str, float]) -> str:
    share = 100 * (1 - row["after"] / row["before"])
    return f"{abs(share):.1f} % {'lower' if share >= 0 else 'higher'}"


def _page(result: Mapping[str, Any], runs: list[tuple[str, Loop, Loop]], plant: Plant, limited: str) -> str:
    unit = result["unit"]
    rows = "".join(
        f'<tr><th scope="row">{html.escape(name)}</th><td>{_told(row["before"], unit)}</td>'
        f'<td class="ours">{_told(row["after"], unit)}</td><td>{_lower(row)}</td></tr>\n'
        for name, row in result["motions"].items()
    )
    table = (
        '<div class="wide"><table><tr><th scope="col">motion</th><th scope="col">PID alone</th>'
        f'<th scope="col">with {html.escape(result["control"])}</th><th scope="col"></th></tr>\n{rows}</table></div>'
    )
    known = "".join(
        f'<tr><th scope="row">{html.escape(name)}</th><td>{value:.4g}</td></tr>\n'
        for name, value in result["parameters"].items()
    )
    values = (
        '<div class="wide"><table><tr><th scope="col">parameter (SI)</th><th scope="col">identified</th></tr>\n'
        f"{known}</table></div>"
    )
    told = (
        f"<p>Diagnosis of the recording with the PID alone: {html.escape(result['verdict'])}; identified "
        f"{html.escape(result['mechanism'])}, compensated {html.escape(result['compensated'] or 'nothing')}. "
        f"Rms tracking error, the first third of each motion left out. {html.escape(limited)}</p>"
    )
    name, before, after = max(runs, key=lambda run: _rms(run[1]))
    caption = f"{name}: tracking error, what compensation leaves of it, and the torque added beside the true friction."
    title = f"Compensation: rms tracking error of {name} {_lower(result['motions'][name])}"
    drawn = picture(png(_figure(before, after, unit, plant.mechanism.system.force_unit, title)), caption)
    return page("Friction compensation, before and after", told + table + drawn + f"<h2>Parameters</h2>{values}")


def _figure(before: Loop, after: Loop, unit: str, force: str, title: str) -> Figure:
    figure = Figure(figsize=(10, 7), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    both = [(before, "baseline", "PID alone"), (after, "model", "compensated")]
    own = [(after, "model", "compensated, on its own scale")]  # beside the PID alone it is a line at zero
    most = max(float(np.abs(loop.error).max()) for loop, *_ in both), float(np.abs(after.error[_late(after)]).max())
    for axes, runs, reach in ((top, both, most[0]), (middle, own, most[1])):
        factor, small = _scaled(reach)
        for loop, color, label in runs:
            axes.plot(loop.t, factor * loop.error, color=INK[color], lw=1.0, label=label)
        axes.set_ylabel(f"tracking error ({small}{readable_unit(unit)})")
        if reach > 0:
            axes.set_ylim(-1.1 * factor * reach, 1.1 * factor * reach)
    middle.axvspan(after.t[0], SKIPPED * after.t[-1], color=INK["band"], zorder=0, label="first third, not counted")
    bottom.plot(after.t, after.friction, color=INK["reference"], lw=1.3, label="true friction")
    known = "added, with its 95 % interval" if (after.high > after.low).any() else "added"
    bottom.plot(after.t, after.added, color=INK["model"], lw=0.9, label=known)
    bottom.fill_between(after.t, after.low, after.high, color=INK["model"], alpha=0.2, lw=0)
    top.set(title=title, xlim=(after.t[0], after.t[-1]))
    bottom.set(xlabel="time (s)", ylabel=f"friction ({readable_unit(force)})")
    for axes in (top, middle, bottom):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.25 * (high - low))
        axes.legend(loc="upper right", frameon=False, fontsize=9, ncols=2)
    return figure
