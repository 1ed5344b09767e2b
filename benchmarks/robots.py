"""Known answers on simulated arms: which effect is named in which joint, false alarms, coverage of intervals, time.

    python benchmarks/robots.py --seeds 2000 2060        (development: seeds below 1000)

Every third arm is clean; of the others one effect at one joint (or on the robot) is not declared. Arms alternate
between a UR10e and one of seven joints; each is recorded twice, 15 s to fit and 8 s held out. Declared is LuGre at
every joint, all inertias free.

An effect is drawn so that its torque, less all that the declared model could take it for along the motion (its
bristle too, which takes a wrist's delay for its own length), is 5 to 10 % of the friction of its joint (a base leans
by 0.03 and 0.02 rad); joints in which no plausible strength makes that are passed over, and arms with a joint that its
load leaves no friction at some time of the recording. Shear thinning is told apart from viscous friction by its bend
alone, 2.6 % at the most: it is drawn at 1 s/rad, which bends most, in joints where that is 1.5 %, with viscous friction
1 to 2 times the dry at 1 rad/s. z is what the bound of Cramer and Rao gives an effect in standard errors
(robot_draw.py). Before, strengths were the same in every arm and joint and motions slower, of 25 s:
results/robots_before.txt.

Results go to results/robots.json as they come; a second call goes on.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
from robot_arms import Arm, NoSuchDraw, draw, recorded, reference, seven
from robot_draw import SHARES, Declared

from frictionpinn.data.public import fetch
from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.diagnose import diagnose
from frictionpinn.robots.identify import declare
from frictionpinn.robots.motion import prepare

RESULTS = Path(__file__).parent / "results"
EFFECTS = ("load_friction", "gain_error", "asymmetry", "ripple", "constant_force", "load_direction", "coupling",
           "base_tilt", "delay", "shear_thinning", "position_friction", "compliance")  # fmt: skip
DURATIONS = (15.0, 8.0)
THINNING = 0.015  # share of its joint's friction that the bend of thinning viscous friction must have
SPEEDS = (1.0, 2.0)  # rad/s, between which a joint's fastest lies: makers allow 2 to 3


def robot_of(seed: int, folder: Path) -> Robot:
    """The UR10e where it can be fetched, of even seeds; else seven joints."""
    if seed % 2 == 0:
        return Robot.read(fetch("ur10e", ["urdf"])["urdf"])
    return Robot.read(seven(folder / "seven.urdf"))


def made(seed: int, folder: Path) -> tuple[Arm, str, int | None, np.random.Generator]:
    """The arm of a seed, its undeclared effect and the joint that has it."""
    rng, robot = np.random.default_rng(seed), robot_of(seed, folder)
    n = len(robot.joints)
    q, v, a = rng.uniform(-0.8, 0.8, (3, 200, n))
    effort = np.maximum(np.sqrt(np.mean(robot.inverse_dynamics(q, v, a) ** 2, axis=0)), 4.0)
    arm = draw(robot, rng, effort)
    if seed % 3 == 0:
        return arm, "", None, rng
    effect = EFFECTS[(seed // 3) % len(EFFECTS)]
    if effect == "base_tilt":
        return replace(arm, tilt=(0.03, -0.02)), effect, None, rng
    if effect == "shear_thinning":  # what thins is thick: viscous friction of gears in much grease
        arm = replace(arm, sigma_2=arm.mu_c * rng.uniform(1.0, 2.0, n))
    share, order = rng.uniform(*SHARES), rng.permutation(n)
    declared = Declared(arm, reference(deepcopy(rng), n, DURATIONS[0], SPEEDS))  # as will be recorded first
    for joint in map(int, order):
        if effect == "shear_thinning":
            bent = replace(arm, effects={effect: {joint: 1.0}})
            with_effect = bent if declared.bound(bent, joint)[0] > THINNING else None
        else:
            with_effect = declared.sized(arm, effect, joint, share)
        if with_effect is not None:
            return with_effect, effect, joint, rng
    raise NoSuchDraw(f"no joint in which {effect} is large enough")


def one(seed: int, folder: Path) -> dict:
    """Simulate and diagnose an arm."""
    arm, effect, joint, rng = made(seed, folder)
    motion = reference(deepcopy(rng), len(arm.mu_c), DURATIONS[0], SPEEDS)
    share, z = Declared(arm, motion).bound(arm, joint) if effect else (0.0, 0.0)
    began = time.perf_counter()
    recording = recorded(arm, rng, DURATIONS, SPEEDS)
    simulated = time.perf_counter() - began
    base = Base.of(arm.robot)
    fitted, held = prepare(recording, arm.robot, base, common=recording.select(["run_1"]))
    d = diagnose(declare(arm.robot, base, LAWS["lugre"]()), [fitted], [held])
    named = [a.term.name.partition(" ")[0] for a in d.accepted]
    alike = [name.partition(" ")[0] for a in d.accepted for name in a.alike]
    wanted = "" if not effect else effect if joint is None else f"{effect}@joint_{joint + 1}"
    inside = {}
    truth = {"mu_c": arm.mu_c, "sigma_2": arm.sigma_2, "armature": arm.armature}
    right = named == ([wanted] if effect else [])
    for k, name in enumerate(d.fit.model.names):
        for par, values in truth.items():
            full = f"armature.{name}" if par == "armature" else f"{name}.{par}"
            if right and full in d.fit.model.free:
                low, high = d.fit.interval(full)
                inside[full] = [bool(low <= values[k] <= high), (d.fit.model.values[full] - values[k]) / values[k]]
    if right and effect and joint is not None and (full := f"joint_{joint + 1}.{effect}") in d.fit.model.free:
        low, high = d.fit.interval(full)
        inside[full] = [bool(low <= arm.effects[effect][joint] <= high), d.fit.model.values[full]]
    errors = d.errors[held.name].mean(axis=1)
    return {
        "seed": seed, "robot": arm.robot.name, "wanted": wanted, "share": share, "z": z, "named": named, "alike": alike,
        "verdicts": dict(d.verdicts), "left": {j: [r.variables, r.size] for j, r in d.rest.items()},
        "found": wanted in named if wanted else not named, "extra": [n for n in named if n != wanted],
        "tied": wanted in alike, "inside": inside, "held_out": [float(e) for e in errors],
        "seconds": {"simulation": round(simulated, 1), "diagnosis": round(d.seconds, 1)},
    }  # fmt: skip


def told(rows: list[dict]) -> str:
    """The table."""
    clean, others = [r for r in rows if not r["wanted"]], [r for r in rows if r["wanted"]]
    lines = [f"{'seed':>5} {'robot':6} {'undeclared':26} {'share':>6} {'z':>5}      named (hardly told apart)"]
    for r in rows:
        tied = f" ({', '.join(sorted(set(r['alike'])))})" if r["alike"] else ""
        mark = "ok" if r["found"] and not r["extra"] else "tied" if r["tied"] else "--"
        names = ", ".join(r["named"]) or "nothing"
        size = f"{100 * r['share']:4.1f} % {r['z']:5.0f}" if r["wanted"] else f"{'':12}"
        errors = " -> ".join(f"{100 * e:.2f}" for e in r["held_out"])
        lines.append(
            f"{r['seed']:5d} {r['robot'][:6]:6} {r['wanted'] or 'nothing':26} {size} {mark:4} {names}{tied}  {errors} %"
            f"  {r['seconds']['diagnosis']:.0f} s"
        )
    inside = [hit for r in rows for hit, _ in r["inside"].values()]
    only = sum(r["found"] and not r["extra"] for r in others)
    lines += [
        f"undeclared effect named in its joint: {sum(r['found'] for r in others)} of {len(others)}; alone: {only}; "
        f"tied with another: {sum(r['tied'] and not r['found'] for r in others)}",
        f"nothing named on clean arms: {sum(r['found'] for r in clean)} of {len(clean)}",
        f"95 % intervals that hold the truth (mu_c, sigma_2, armature, the effect; where the model is right): "
        f"{sum(inside)} of {len(inside)}" + (f", {100 * np.mean(inside):.0f} %" if inside else ""),
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(2000, 2060))
    parser.add_argument("--label", default="robots")
    parser.add_argument("--minutes", type=float, default=1e9)
    args = parser.parse_args()
    path = RESULTS / f"{args.label}.json"
    rows = json.loads(path.read_text()) if path.exists() else []
    done, began = {r["seed"] for r in rows}, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(*args.seeds):
            if seed in done or time.perf_counter() - began > 60 * args.minutes:
                continue
            try:
                rows.append(one(seed, Path(folder)))
            except NoSuchDraw as none:
                print(f"seed {seed}: {none}", flush=True)
                continue
            path.write_text(json.dumps(sorted(rows, key=lambda r: r["seed"]), indent=1) + "\n")
            print(told(rows[-1:]).splitlines()[1], flush=True)
    text = told(sorted(rows, key=lambda r: r["seed"]))
    (RESULTS / f"{args.label}.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
