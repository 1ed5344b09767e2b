"""Errors, shares and remainders of a diagnosis in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .diagnosis import Diagnosis
from .floor import RESIDUAL
from .page import share
from .unexplained import Unexplained


def beyond(d: Diagnosis, entry: Mapping[str, Any]) -> str:
    """The error beyond the noise, before and after, in words."""
    what = entry["quantity"].replace("rms error of", "error of")
    old, new = (in_words(entry[key]) for key in ("excess_before", "excess_after"))
    return (f"{what[0].upper()}{what[1:]} beyond the noise, {d.scored}, {entry['unit']}: {old} before, {new} after; "
            f"{noise_in_words(entry)}")  # fmt: skip


def in_words(told: Mapping[str, Any]) -> str:
    """A value with its 95 % interval."""
    return f"{told['value']:.3g} ({told['ci95'][0]:.3g} to {told['ci95'][1]:.3g})"


def noise_in_words(entry: Mapping[str, Any]) -> str:
    """The noise, where its level is known from, and what else it may be."""
    if entry["noise_from"] == RESIDUAL:
        text = f"the model's own residual is taken for the noise, {entry['noise_floor']:.3g}"
        other = "neighbouring samples differ by"
    else:
        text, other = f"noise floor {entry['noise_floor']:.3g}, from {entry['noise_from']}", "the model leaves"
    if entry["noise_other"] is None:
        return text
    return f"{text} ({other} {entry['noise_other']:.3g}: noise correlated in time, or a model far off)"


def shared(d: Diagnosis) -> str:
    """How much each effect took off, and how much is left: one sentence; empty where nothing was added."""
    if not d.shares or d.left["value"] is None:
        return ""
    each = " and ".join(
        f"{a.candidate.name} took off {share(own)}" for a, own in zip(d.accepted, d.shares, strict=True)
    )
    rest = d.unexplained or d.trifle
    after = f"; it depends on {depends(rest)}" if rest is not None else ""
    return (f" Of the squared error of {d.main.replace('_', ' ')} beyond the noise {each}; {share(d.left)} is left"
            f"{after}.")  # fmt: skip


def depends(rest: Unexplained) -> str:
    """The variables of a remainder."""
    return " or ".join(rest.depends_on[:3]).replace("_", " ")


def negligible(d: Diagnosis) -> str:
    """What is significant but does not matter: one sentence, or empty."""
    if d.trifle is None:
        return ""
    what = "friction" if d.trifle.kind == "friction" else "a force"
    return (f" Significant but small: {what} that depends on {depends(d.trifle)}, {100 * d.trifle.size:.2g} % of the "
            f"friction force (diagnose.worth: {100 * d.settings.worth:.2g} %).")  # fmt: skip


def untested(d: Diagnosis) -> str:
    """How many candidates could not be tested: one sentence, or empty."""
    refused = {r.candidate.name for r in d.refused if "could not be tested" in r.why}
    if not refused:
        return ""
    return f" {len(refused)} candidates could not be tested: their derivatives overflow in the simulation."
