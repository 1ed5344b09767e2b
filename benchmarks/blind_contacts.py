"""Blind recordings of mechanisms with two contacts: what a diagnosis finds, and at which of them.

    python benchmarks/blind_contacts.py [--kinds effects undeclared clean] [--repeats 20] [--from-seed 1000]
    python benchmarks/blind_contacts.py --again        # what another commit answered is asked anew
    python benchmarks/blind_contacts.py --report       # of the recordings that were diagnosed so far

Trials of a system's own file, the last held out, 5 % noise on every signal, 100 Hz.

    effects     pob_hinge, cartpole and two_mass in turn, LuGre at both contacts, and one effect at one of them that
                makes 5 to 10 % of the friction there (root mean square), or more where the declared laws at their best
                leave less of that than a test at the significance of a diagnosis finds in 99 of 100 recordings
    undeclared  pob_hinge, whose hinge is declared without friction; it has some, Coulomb or viscous by turns, of 3 to
                10 % of the torque
    clean       the same with nothing in the hinge

Right is the effect that acts, named first; or named as alike to the one that is named first, where by the bound these
data do not tell the two apart (a force that is constant and friction that is stronger one way differ in stops alone).

The diagnosis sees the recording and the declared laws, nothing else. It was developed on seeds below 1000. Each answer
is kept in benchmarks/results/blind_contacts.json as it comes and not asked for again but with --again, on the same
recording: how strong the effect is was found once, with a fit of its own, and is read from there.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import sympy as sp
from omegaconf import OmegaConf
from scipy.stats import norm

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.contenders import TESTED, Settings
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.base import CONTACT
from frictionpinn.physics.contacts import by_parameter, law_named
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.provenance import commit

ROOT = Path(__file__).resolve().parents[1]
RESULTS, NOISE, RATE = ROOT / "benchmarks" / "results", 0.05, 100.0
PLACES = (("pob_hinge", "box"), ("pob_hinge", "hinge"), ("cartpole", "rail"), ("cartpole", "bearing"),
          ("two_mass", "motor"), ("two_mass", "load"))  # fmt: skip
# Effect -> the strength that carries its size; whether either sign occurs.
STRENGTHS = {"asymmetry": ("asymmetry", True), "constant_force": ("constant_force", True), "drag": ("drag", False),
             "asymmetric_viscous": ("asymmetric_viscous", True)}  # fmt: skip
SHARES = {"effects": (0.05, 0.10), "undeclared": (0.03, 0.10)}
# Standard errors that are found in 99 of 100 at the significance of a diagnosis, and those that tell two effects apart.
FOUND = float(norm.isf(10**Settings.log_p / TESTED / 2) + norm.ppf(0.99))
TOLD = float(np.sqrt(2 * Settings.told_apart))


@cache
def bed(name: str, frictionless: str = "") -> tuple[Mechanism, dict[str, float], Recording]:
    """Mechanism as declared, true parameters and the recording without noise and without any effect."""
    declared = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{name}.yaml"), resolve=True)
    system, made = SYSTEMS[name](**declared["parameters"]), declared["simulate"]
    laws = made["friction"] | ({frictionless: "none"} if frictionless else {})
    mechanism = Mechanism(system, law_named(laws, "friction"))
    known = {par.name for par in mechanism.law.parameters}
    truth = {key: value for key, value in by_parameter(made["truth"], mechanism.law).items() if key in known}
    return mechanism, truth, simulate_recording(system, laws, truth, made["trials"], RATE)


def size(mechanism: Mechanism, truth: dict[str, float], clean: Recording, strength: str) -> float:
    """Root mean square of the force that an effect, the mechanism's last, makes at its contact along the undisturbed
    motion where its strength is 1."""
    effect = mechanism.effects[-1]
    (at,) = (contact for contact in mechanism.contacts if contact.name == effect.contact)
    made, prefix = sp.Symbol("made", real=True), f"{at.name}."
    share = effect.load(CONTACT.N, CONTACT, mechanism.p) / CONTACT.N - 1
    change = at.in_motion(share * made + effect.force(CONTACT, mechanism.p, mechanism.law))
    numbers = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values | truth | {strength: 1.0}
    change = change.xreplace({par.symbol: sp.Float(numbers[par.name]) for par in mechanism.parameters})
    known = {s: n for c in mechanism.system.moving for s, n in zip(c.symbols, c.signals, strict=True)}
    squares = []
    for trial in clean.trials:
        values = {s: trial.signals[n] for s, n in known.items()} | {made: trial.truth[f"{prefix}friction_force"]}
        symbols = sorted(change.free_symbols, key=str)
        force = sp.lambdify(symbols, change, "numpy")(*(values[s] for s in symbols))
        squares.append(np.broadcast_to(force, trial.t.shape) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def left(declared: Mechanism, truth: dict[str, float], clean: Recording) -> float:
    """Root of twice the log-likelihood that the declared laws, fitted to a recording without noise, lack at the level
    of the noise: the standard errors by which what acts in it stands out."""
    problem = Problem(declared, clean, sigmas=GaussianNoise(NOISE).levels(clean))
    found = maximum_likelihood(problem, start=truth, thorough=False, profiles=False).minimum
    return 0.0 if found is None else float(np.sqrt(2 * found.state.cost))


def told(mechanism: Mechanism, truth: dict[str, float], seen: Recording, strength: str) -> dict[str, float]:
    """Strength over its least standard error, Cramer-Rao: beside the law ("") and beside that and each other effect."""
    at = {
        f"{effect}@{c.name}": f"{c.name}.{plain}"
        for c in mechanism.contacts
        for effect, (plain, _) in STRENGTHS.items()
    }
    law = [par.name for par in mechanism.law.parameters if par.value is None]
    every = Mechanism(mechanism.system, mechanism.law, tuple(at))
    best = bound(every, seen, dict.fromkeys(at.values(), 0.0) | truth, free=[*law, *at.values()])
    place = {name: k for k, name in enumerate(best.names)}
    value = best.space.to_search(best.values)[place[strength]]

    def beside(*others: str) -> float:
        k, rest = place[strength], [place[name] for name in (*law, *others)]
        scale = np.sqrt(best.information.diagonal())
        S = best.information / np.outer(scale, scale)
        left = S[k, k] - S[k, rest] @ np.linalg.lstsq(S[np.ix_(rest, rest)], S[rest, k], rcond=1e-13)[0]
        return float(abs(value) * scale[k] * np.sqrt(max(left, 0.0)))

    return {"": beside()} | {effect: beside(name) for effect, name in at.items() if name != strength}


def rms(rows: list[np.ndarray]) -> float:
    """Root mean square over all trials."""
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


@dataclass(frozen=True)
class Draw:
    """The declared mechanism, the recording, the effect that acts in it, its strengths, and what the bound says."""

    mechanism: Mechanism
    recording: Recording
    effect: str = ""
    values: dict[str, float] = field(default_factory=dict)
    told: dict[str, float] = field(default_factory=dict)


def draw(kind: str, seed: int, known: dict | None = None) -> Draw:
    """A recording of this kind; one that was answered before (`known`) as it was then."""
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    if kind == "effects":
        name, contact = PLACES[seed % len(PLACES)]
        effect = list(STRENGTHS)[seed // len(PLACES) % len(STRENGTHS)]
        (plain, signed), (declared, truth, clean) = STRENGTHS[effect], bed(name)
        against = rms([trial.truth[f"{contact}.friction_force"] for trial in clean.trials])
    else:
        name, contact, effect = "pob_hinge", "hinge", "friction" if kind == "undeclared" else ""
        plain, signed, (declared, truth, clean) = ("mu_c", "sigma_2")[seed % 2], False, bed(name, "hinge")
        against = rms([trial.signals["tau"] for trial in clean.trials if "tau" in trial.signals])
    noise = GaussianNoise(NOISE)
    if not effect:
        return Draw(declared, noise(clean, seed))
    located, strength = f"{effect}@{contact}", f"{contact}.{plain}"
    mechanism = Mechanism(declared.system, declared.law, (located,))
    share = rng.uniform(*SHARES[kind]) * (rng.choice([-1, 1]) if signed else 1)
    values = {strength: float(share * against / size(mechanism, truth, clean, strength))}
    trials = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{name}.yaml"))["simulate"]["trials"]
    laws = {at.name: at.law.name for at in declared.contacts}

    def made() -> Recording:
        return simulate_recording(declared.system, laws, truth | values, trials, RATE, [located])

    if known:
        values = known["values"]
        return Draw(declared, noise(made(), seed), located, values, known["told"])
    if kind != "effects":
        return Draw(declared, noise(made(), seed), located, values)
    fitted = made().names[:-1]

    def seen() -> dict[str, float]:
        return told(declared, truth | values, noise(made(), seed).select(fitted), strength)

    # To first order, where simulations without noise are worth more than their own errors; then as it is.
    values[strength] *= max(FOUND / seen()[""], 1.0)
    values[strength] *= max(FOUND / left(declared, truth, made().select(fitted)), 1.0)
    return Draw(declared, noise(made(), seed), located, values, seen())


def run(kind: str, seed: int, known: dict | None = None) -> dict:
    """One recording and what the diagnosis says of it, `known` being what was answered before."""
    own = draw(kind, seed, known)
    recording, names, began = own.recording, own.recording.names, time.perf_counter()
    case = {"kind": kind, "seed": seed, "system": own.mechanism.system.name, "effect": own.effect, "values": own.values,
            "told": own.told, "commit": (commit() or "")[:7]}  # fmt: skip
    try:
        d = diagnose(own.mechanism, recording.select(names[:-1]), recording.select(names[-1:]))
    except Exception as error:
        return case | {"failed": f"{type(error).__name__}: {error}", "seconds": time.perf_counter() - began}
    rest = d.unexplained
    return case | {
        "verdict": d.verdict,
        "effects": [a.candidate.effect for a in d.accepted],
        "groups": [a.candidate.group for a in d.accepted],
        "alike": [[c.effect for c, _ in a.alike] for a in d.accepted],
        "found": {n: [d.values[n], *d.ci95[n]] for a in d.accepted for n in a.candidate.strengths},
        "depends_on": list(rest.depends_on[:3]) if rest else [],
        "first": [[t.candidate.name, t.log_p] for t in d.selection.first.tested[:5]],
        "seconds": time.perf_counter() - began,
    }


def named(case: dict) -> bool:
    """Whether the first effect, at its contact, is the one that acts; of a clean recording, that nothing is missing."""
    if "failed" in case:
        return False
    return case["effects"][:1] == [case["effect"]] if case["effect"] else case["verdict"] == "nothing missing"


def right(case: dict) -> bool:
    """Whether it is named, or is said to be alike to what is named, where these data do not tell them apart."""
    if named(case) or "failed" in case or not case["effects"]:
        return named(case)
    return case["effect"] in case["alike"][0] and case["told"].get(case["effects"][0], np.inf) < TOLD


def report(cases: list[dict]) -> str:
    """The table of all kinds."""
    lines = ["python benchmarks/blind_contacts.py: two contacts, 5 % noise on every signal, 100 Hz; seeds from 1000 on",
             "                right  named  alone  inside 95 %  median s  wrong"]  # fmt: skip
    for kind in ("effects", "undeclared", "clean"):
        own = [c for c in cases if c["kind"] == kind and c["seed"] >= 1000]
        good = [c for c in own if right(c)]
        alone = sum(len(c["effects"]) <= 1 for c in good)
        inside = [low <= c["values"][n] <= high for c in good for n, (_, low, high) in c["found"].items()
                  if n in c["values"]]  # fmt: skip
        wrong = "; ".join(f"{c['seed']} {c['system']} {c['effect'] or 'nothing'} -> {_answer(c)}"
                          for c in own if not right(c))  # fmt: skip
        seconds = f"{np.median([c['seconds'] for c in own]):.0f}" if own else ""
        count, within = f"{len(good)}/{len(own)}", f"{sum(inside)}/{len(inside)}"
        lines.append(
            f"{kind:12s} {count:>7s} {sum(map(named, own)):6d} {alone:6d} {within:>12s} {seconds:>9s}  {wrong}"
        )
    return "\n".join(lines) + "\n"


def _answer(case: dict) -> str:
    return case.get("failed") or " and ".join([case["verdict"], *case["effects"], *case["depends_on"][:1]])


def asked(kinds: list[str], seeds: range) -> Iterator[tuple[str, int]]:
    """Kinds and seeds, every kind once, then again."""
    yield from ((kind, seed) for seed in seeds for kind in kinds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", default=["effects", "undeclared", "clean"])
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--from-seed", type=int, default=1000)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--report", action="store_true")
    args = parser.parse_args()
    path, now = RESULTS / "blind_contacts.json", (commit() or "")[:7]
    answers = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    done = {(case["kind"], case["seed"]): case for case in answers}
    for kind, seed in asked(args.kinds, range(args.from_seed, args.from_seed + (0 if args.report else args.repeats))):
        known = done.get((kind, seed))
        if known is None or (args.again and known["commit"] != now):
            done[kind, seed] = case = run(kind, seed, known)
            path.write_text(json.dumps(list(done.values()), indent=1) + "\n", encoding="utf-8")
            print(kind, seed, case["system"], case["effect"] or "nothing", "right" if right(case) else "WRONG",
                  _answer(case), f"{case['seconds']:.0f} s", flush=True)  # fmt: skip
    text = report(list(done.values()))
    (RESULTS / "blind_contacts.txt").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
