"""One diagnosis: from a resolved configuration to ``result.json``, figures, a page and an augmented model."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..data.split import split_trials
from ..diagnose.diagnosis import Diagnosis
from ..diagnose.diagnosis import diagnose as run_diagnosis
from ..diagnose.select import Settings
from ..diagnose.verdict import FOUND, NO_VERDICT, PARTLY, UNEXPLAINED
from ..errors import UserError, choose
from ..export.augmented import save_augmented
from ..physics import System
from ..physics.effects import EFFECTS
from ..physics.mechanism import Mechanism
from ..physics.notation import equations, in_latex, in_mathml
from ..progress import shorter
from ..report.diagnosis import gain_together, headline, write_page
from ..report.diagnosis_figures import draw
from ..report.words import number, span
from ..show import plain, readable_unit
from .build import (
    Config,
    build_noise,
    build_recording,
    build_system,
    check_pairing,
    estimated_law,
    law_table,
    seed_of,
)
from .configs import called
from .manifest import write_json
from .provenance import commit, versions
from .vet import vet

log = logging.getLogger(__name__)

LAST = 0.3  # of a recording's only trial: held out


def diagnose(cfg: Config, folder: Path) -> dict[str, Any]:
    """Diagnose the declared model of ``cfg`` and write everything that a user needs of it to ``folder``.

    Args:
        cfg: resolved conf/diagnose.yaml.
        folder: of this diagnosis.

    Returns:
        What stands in ``result.json``.

    Raises:
        UserError: anything that the user can mend.
    """
    if cfg["system"]["name"] == "robot":
        from . import robot

        return robot.diagnose(cfg, folder)
    options = checked(cfg)
    check_pairing(cfg)
    system = build_system(cfg["system"])
    law = estimated_law(cfg["friction"], system)
    recording = build_noise(cfg["noise"])(build_recording(cfg["data"], system), seed_of(cfg))
    vet(cfg, system, recording, options["free"] or ())
    return report(examine(cfg, Mechanism(system, law, tuple(options["declared"])), recording), cfg, folder)


def examine(cfg: Config, mechanism: Mechanism, recording: Recording) -> Diagnosis:
    """Diagnose a declared model on a recording with the options of ``cfg``.

    Args:
        cfg: of conf/diagnose.yaml the sections ``diagnose``, ``data`` (held_out), ``friction`` (start, bounds, fixed).
        mechanism: the declared model.
        recording: what was measured.

    Raises:
        UserError: anything that the user can mend.
    """
    options = checked(cfg)
    recording = chosen_signals(recording, options["signals"], mechanism.system)
    fitted, held_out = split(recording, cfg["data"])
    of = f" on {recording.source}" if recording.source else ""
    log.info(f"diagnosing {mechanism.name}{of}: fitted to {', '.join(fitted.names)}; held out: "
             f"{', '.join(held_out.names) or 'none'}")  # fmt: skip
    settings = Settings(
        float(options["log10_p"]), int(options["most"]), worth=float(options["worth"]), samples=int(options["samples"])
    )
    wanted = {key: options[key] for key in ("inputs", "initial", "windows", "free", "loss")}
    friction = {key: law_table(cfg["friction"], key, mechanism.law) for key in ("start", "bounds", "fixed")}
    effects = None if options["effects"] == "all" else options["effects"]
    shorter(_shorter(fitted, options))
    d = run_diagnosis(
        mechanism, fitted, held_out, effects=effects, settings=settings, start=friction["start"] or None,
        bounds=friction["bounds"], fixed=friction["fixed"], network=options["fallback"] == "network", **wanted,
    )  # fmt: skip
    return replace(d, config=cfg)


def report(d: Diagnosis, cfg: Config, folder: Path) -> dict[str, Any]:
    """Write result.json, figures, the page, TensorBoard and the augmented model."""
    folder.mkdir(parents=True, exist_ok=True)
    augmented = save_augmented(folder / "augmented.yaml", d, cfg["data"])
    result = as_dict(d) | {
        "data": {
            "source": d.fitted.source, "sha256": d.fitted.checksum, "fitted": list(d.fitted.names),
            "held_out": list(d.held_out.names), "samples": len(d.fitted) + len(d.held_out),
            "samples_given": sum(len(recording) for recording in d.whole),
        },
        "augmented_model": "augmented.yaml",
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }  # fmt: skip
    written = equations(augmented, d.values)
    result["equation"] = "\n".join(in_latex(e) for e in written)
    paths = draw(folder / "figures", d)
    result["figures"] = [str(p.relative_to(folder)) for p in paths]
    write_json(folder / "result.json", result)
    write_page(folder / "report.html", result, headline(d), in_mathml(written), paths, gain_together(d))
    dashboard(folder / "tensorboard", d, paths)
    log.info(headline(d))
    for sentence in d.declared.advice:
        log.info(f"  the declared model's fit: {sentence}")
    for effect in result["effects"]:
        log.info(f"  {effect['name']}: {effect['is']}")
        for name, p in effect["parameters"].items():
            value = f"{number(p['value'], p['ci95'])} {readable_unit(p['unit'])}".rstrip()
            log.info(f"  {effect['name']}: {name} = {value} [{span(p['ci95'])}]")
    if d.network is not None:
        error = result["unexplained"]["network"]["error"]
        log.info(
            f"  a network of {d.network.effect.variable} in its place: {error['quantity']} {error['before']:.4g} -> "
            f"{error['after']:.4g} {readable_unit(error['unit'])} (noise {error['noise_floor']:.4g}); "
            "part of the augmented model"
        )
    log.info(f"result.json, figures, the augmented model and the page report.html are in {folder}")
    log.info(f"next: {next_step(d, folder)}")
    return result


def next_step(d: Diagnosis, folder: Path) -> str:
    """What the verdict suggests to do."""
    if d.verdict in (FOUND, PARTLY) and len(d.bench.mechanism.contacts) > 1:
        return "load_augmented takes augmented.yaml to simulate with; networks learn the friction of one contact so far"
    if d.verdict in (FOUND, PARTLY):
        model = "pe2" if d.bench.mechanism.law.memory else "bb1"
        path = os.path.relpath(folder / "augmented.yaml")
        return f"{called('train')} model={model} friction={path} learns the law beside them"
    if d.verdict == NO_VERDICT:
        return f"mend what the doubts name; {called('check')} says what the recording holds"
    if d.verdict == UNEXPLAINED:
        return f"{called('diagnose')} with diagnose.fallback=network puts a network in the place of the rest"
    if not d.fit.white:
        return f"{called('check')} says whether signals are filtered; other values of friction.start may lead lower"
    return f"the model is complete as far as this recording tells; {os.path.relpath(folder)}/report.html shows it"


def as_dict(d: Diagnosis) -> dict[str, Any]:
    """A diagnosis as plain types: verdict, effects, error, left, unexplained, refused, parameters."""
    units, rest = d.units, d.unexplained
    effects = []
    for a, own in zip(d.accepted, d.shares, strict=True):
        names = [n for n in (*a.candidate.strengths, *a.candidate.hidden) if n in d.values]
        effects.append({
            "name": a.candidate.effect,
            "is": in_words(a.candidate.effect),
            "group": a.candidate.group,
            "parameters": {n: {"value": d.values[n], "unit": units[n], "ci95": [plain(x) for x in d.ci95[n]]}
                           for n in names},
            "share_of_excess": own,
            "evidence": {key: plain(float(value)) for key, value in a.evidence.items()},
            "indistinguishable_from": list(dict.fromkeys(c.effect if c.effect != a.candidate.effect else c.name
                                                         for c, _ in a.alike)),
            "separate": separate(a.candidate.effect, [c.effect for c, _ in a.alike]),
        })  # fmt: skip
    before = d.declared.to_dict()["parameters"]
    parameters = {n: {"value": d.values[n], "unit": units[n], "ci95": [plain(x) for x in d.ci95[n]],
                      "before": before.get(n)} for n in d.values}  # fmt: skip
    system = d.bench.mechanism.system
    main = {key: value for key, value in d.errors[d.main].items() if key != "relative"}
    return {
        "verdict": d.verdict,
        "doubts": list(d.doubts),
        "advice": list(d.declared.advice),
        "model": {"system": system.title, "friction": d.bench.mechanism.law.name,
                  "declared": [e.name for e in d.bench.mechanism.effects]},
        "effects": effects,
        "inseparable": list(dict.fromkeys(c.effect for c in d.inseparable)),
        "error": main | {"on": d.scored},
        "errors": d.errors,
        "left": d.left,
        "negligible": None if d.trifle is None else {
            "depends_on": list(d.trifle.depends_on), "kind": d.trifle.kind, "size": d.trifle.size,
        },
        "unexplained": None if rest is None else {
            "size": rest.size, "depends_on": list(rest.depends_on), "kind": rest.kind, "share": plain(rest.share),
            "confirmed": rest.confirmed,
            "formula": rest.formula, "unit": rest.unit, "log10_p": plain(rest.log_p),
            "shape": {"x": rest.x.tolist(), "y": rest.shape.tolist(), "std": rest.error.tolist()},
            "network": _network(d),
        },
        "refused": [{"name": r.candidate.name, "why": r.why} for r in d.refused],
        "parameters": parameters,
        "declared": d.declared.to_dict(),
        "noise": {name: {"value": s, "unit": system.signal_units.get(name, "")} for name, s in d.noise.items()},
        "coloured": list(d.coloured),
        "loss": "robust" if d.bench.problem.loss.robust else "gaussian",
        "seconds": round(d.seconds, 2),
    }  # fmt: skip


def _network(d: Diagnosis) -> dict[str, Any] | None:
    """The fallback term: what it depends on, its parameters, and the error before and after it."""
    if d.network is None:
        return None
    net = d.network
    error = {key: value for key, value in net.errors[d.main].items() if key != "relative"}
    return {"depends_on": net.effect.variable, "kind": net.kind, "parameters": net.values, "error": error,
            "errors": net.errors}  # fmt: skip


def in_words(name: str) -> str:
    """What an effect is and where it occurs, as its docstring says; empty of one that has none."""
    told = EFFECTS[name].said() if name in EFFECTS else {}
    occurs = f"Occurs: {told['occurs']}" if told.get("occurs") else ""
    return " ".join(filter(None, [told.get("equation", ""), occurs])).replace("``", "")


def separate(name: str, others: list[str]) -> str:
    """The experiments that show an effect and those that it is not told apart from."""
    if not others:
        return ""
    kinds = dict.fromkeys(n.partition("@")[0] for n in (name, *others))
    told = {n: EFFECTS[n].said().get("experiment", "") for n in kinds if n in EFFECTS}
    return "; ".join(f"{n}: {text.rstrip('.')}" for n, text in told.items() if text) + "."


def dashboard(folder: Path, d: Diagnosis, figures: list[Path]) -> None:
    """Errors, evidence and figures for TensorBoard."""
    from .event_files import write_events

    scalars = {f"error/{name}": [entry["before"], entry["after"]] for name, entry in d.errors.items()}
    scalars |= {f"evidence/{t.candidate.name}": [-t.log_p] for t in d.selection.first.tested}
    images = {f"diagnosis/{path.stem}": path for path in figures}
    write_events(folder, scalars, images, {"verdict": headline(d)})


def split(recording: Recording, data: Config) -> tuple[Recording, Recording]:
    """Trials to fit and to hold out: as named, none for an empty list; else the last, or the end of the only one."""
    if len(recording.trials) == 1 and data.get("held_out") is None:
        (trial,) = recording.trials
        first = int(len(trial.t) * (1 - LAST))
        parts = []
        for name, part in (("start", slice(0, first)), ("end", slice(first, None))):
            parts.append(trial.part(part, f"{trial.name} ({name})"))
        made = [Recording((p,), recording.units, recording.source, recording.checksum) for p in parts]
        return made[0], made[1]
    splits = split_trials(recording.names, data.get("held_out"), data.get("validation"), data.get("training_trials"))
    return recording.select(splits["train"]), recording.select(splits["held_out"])


def chosen_signals(recording: Recording, names: list[str] | None, system: System) -> Recording:
    """The recording with these signals of the motion alone: those that were derived from others carry no news of their
    own. Forces stay: they move the model."""
    if names is None:
        return recording
    if not isinstance(names, list):
        raise UserError("not a list of signals", where="diagnose.signals", received=repr(names), allowed=f"[{names}]")
    present = recording.trials[0].signals
    for name in names:
        choose(name, dict.fromkeys(present), "diagnose.signals")
    kept = {*names, *(item.name for item in system.inputs)}
    trials = [replace(t, signals={n: y for n, y in t.signals.items() if n in kept}) for t in recording.trials]
    return replace(recording, trials=tuple(trials))


def _shorter(fitted: Recording, options: Config) -> str:
    """Why a diagnosis is long, and what makes it shorter."""
    ways = ["data.rate_hz", *([] if options["inputs"] == "fixed" else ["diagnose.inputs=fixed where inputs are clean"]),
            *(["diagnose.effects=[...]"] if options["effects"] == "all" else []), "diagnose.most=1"]  # fmt: skip
    return f"{len(fitted)} samples are simulated anew for every effect that is tried; shorter with {', '.join(ways)}"


def checked(cfg: Config) -> dict[str, Any]:
    """The section ``diagnose``, its names and numbers checked."""
    options = dict(cfg["diagnose"])
    if cfg["smoothing"]["name"] != "none":
        raise UserError("a diagnosis does not smooth: it estimates the motion with the parameters", where="smoothing",
                        received=cfg["smoothing"]["name"], allowed="none", fix="leave smoothing= out")  # fmt: skip
    for key in ("effects", "declared"):
        names = options[key]
        if key == "effects" and names == "all":
            continue
        if not isinstance(names, list):
            raise UserError("not a list of effects", where=f"diagnose.{key}", received=repr(names),
                            allowed=("all, " if key == "effects" else "") + "a list such as [drag, delay]")  # fmt: skip
        for name in names:
            choose(name.partition("@")[0], EFFECTS, f"diagnose.{key}")
    if not isinstance(free := options["free"], list | type(None)):
        raise UserError("not a list of names", where="diagnose.free", received=repr(free), allowed=f"[{free}], or null")
    if not isinstance(options["log10_p"], int | float) or not -300 < options["log10_p"] < 0:
        raise UserError("impossible threshold", where="diagnose.log10_p", received=options["log10_p"],
                        allowed="a negative number, -2 for 1 %")  # fmt: skip
    if not isinstance(options["most"], int) or options["most"] < 1:
        raise UserError("impossible number of effects", where="diagnose.most", received=options["most"],
                        allowed="at least 1")  # fmt: skip
    if not isinstance(options["samples"], int) or options["samples"] < 1000:
        raise UserError("impossible number of samples", where="diagnose.samples", received=options["samples"],
                        allowed="at least 1000")  # fmt: skip
    worth = options["worth"]
    if not isinstance(worth, int | float) or isinstance(worth, bool) or not 0 <= worth < 1:
        raise UserError("impossible share", where="diagnose.worth", received=worth,
                        allowed="a share of the friction force, 0.01 for 1 %; 0: whatever is significant")  # fmt: skip
    choose(options["fallback"] or "null", {"null": 1, "network": 1}, "diagnose.fallback")
    choose(options["loss"], {"auto": 1, "gaussian": 1, "robust": 1}, "diagnose.loss")
    if options["windows"] is not None and not (np.isfinite(options["windows"]) and options["windows"] > 0):
        raise UserError("impossible windows", where="diagnose.windows", received=options["windows"],
                        allowed="null, or a length in s")  # fmt: skip
    return options
