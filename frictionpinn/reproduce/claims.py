"""The paper's claims, each decided by the result files."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping
from typing import Any

Result = Mapping[str, Any]
HOLDS, FAILS = "holds", "does not hold"
NEAR = 1.5  # a transferred model within this factor of one trained on the system counts as transferred


def claims(found: Mapping[str, Result]) -> Iterator[tuple[str, str, str]]:
    """Claim, verdict and the figures it rests on, for every part that was run."""
    if "fidelity" in found:
        yield from _fidelity(found["fidelity"]["errors"])
    if "transfer" in found:
        yield from _transfer(found["transfer"])
    if "identification" in found:
        yield from _identification(found["identification"]["protocols"])


def _fidelity(errors: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    fitted = any("as_trained_pe1" in methods for methods in errors.values())
    of = " (both fitted in motion)" if fitted else ""
    yield _ordered(f"In simulation PE1 is better than BB1{of}", errors, "in_simulation", "pe1", "bb1")
    yield _ordered("Online PE1 is better than BB1", errors, "online", "pe1", "bb1")
    yield _ordered("The frictionless acceleration helps online: PE2 is better than PE1", errors, "online", "pe2", "pe1")
    yield _ordered("and BB2 better than BB1", errors, "online", "bb2", "bb1")
    rivals = {key for methods in errors.values() for key, row in methods.items() if not row["model"]}
    for key in ("coulomb", "coulomb_viscous", *sorted(k for k in rivals if k.startswith(("mujoco", "pybullet")))):
        label = next((methods[key]["label"] for methods in errors.values() if key in methods), None)
        if label:
            ours = "PE1 (fitted in motion)" if fitted else "PE1"
            claim = f"In simulation {ours} is more faithful than what simulators use: {label}"
            yield _ordered(claim, errors, "in_simulation", "pe1", key)
    if fitted:
        claim = "So is PE1 as trained, without the fit in motion: Coulomb + viscous fit"
        yield _ordered(claim, errors, "in_simulation", "as_trained_pe1", "coulomb_viscous")
    if any("identified" in methods for methods in errors.values()):
        claim = "Beyond the paper: online an observer with identified LuGre friction is better than PE2"
        yield _ordered(claim, errors, "online", "identified", "pe2")
        claim = "Beyond the paper: in simulation identified LuGre friction is more faithful than PE1"
        yield _ordered(claim, errors, "in_simulation", "identified", "pe1")
        if any("mujoco" in methods for methods in errors.values()):
            yield _ordered("and than MuJoCo's own friction", errors, "in_simulation", "identified", "mujoco")


def _ordered(claim: str, errors: Mapping[str, Any], kind: str, better: str, worse: str) -> tuple[str, str, str]:
    told, holds = [], []
    for trajectory, methods in errors.items():
        a, b = (methods.get(key, {}).get(kind, {}).get("value") for key in (better, worse))
        if a is None or b is None:
            continue
        told.append(f"{trajectory}: {a:.3g} against {b:.3g} N², {b / a:.3g} times")
        holds.append(a < b)
    if not told:
        return claim, "not measured", "-"
    verdict = HOLDS if all(holds) else FAILS if not any(holds) else "holds on one of the trajectories"
    return claim, verdict, "; ".join(told)


def _transfer(result: Result) -> Iterator[tuple[str, str, str]]:
    for kind, text in (("in_simulation", "in simulation"), ("online", "online")):
        ratio = result["ratios"].get("pe1", {}).get("pob > sdob", {}).get(kind)
        if ratio is not None:
            claim = f"PE1 trained on the pendulum on a box carries over to the spring-damper on a box, {text}"
            verdict = HOLDS if ratio <= NEAR else FAILS
            yield claim, verdict, f"{ratio:.3g} times the error of the PE1 trained there"


def _identification(protocols: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    titles = {"near": "near bounds", "decade": "bounds of a decade"}
    for name, protocol in protocols.items():
        errors, times = (_medians(protocol, key) for key in ("force_mse", "processor_seconds"))
        ours = {key: errors[key] for key in ("pe1", "pe2") if key in errors}
        rivals = {key: errors[key] for key in ("nelder_mead", "genetic", "least_squares") if key in errors}
        if not ours or not rivals:
            continue
        best = min(rivals, key=rivals.__getitem__)
        holds = min(ours.values()) < rivals[best]
        told = f"better PE {min(ours.values()):.3g} N² force error, {best.replace('_', ' ')} {rivals[best]:.3g} N²"
        yield f"PEs identify better than the search methods, {titles[name]}", HOLDS if holds else FAILS, told
        slow = min(times[key] for key in ours)
        fast = min(times[key] for key in rivals)
        told = f"quicker PE {slow:.3g} s, quickest search {fast:.3g} s of processor time, on the same fast simulator"
        yield f"and faster, {titles[name]}", HOLDS if slow < fast else FAILS, told


def _medians(protocol: Result, key: str) -> dict[str, float]:
    """Method -> median over the seeds that have the entry; methods without any are left out."""
    known = {method: [run[key] for run in runs if run[key] is not None] for method, runs in protocol["methods"].items()}
    return {method: statistics.median(values) for method, values in known.items() if values}
