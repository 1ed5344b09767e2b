"""The report of a diagnosis: its verdict in words, and one self-contained page with figures and the equation."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template

from ..data.findings import listed
from ..diagnose.diagnosis import Diagnosis
from ..diagnose.errors import FORCE
from ..diagnose.verdict import FOUND, NO_VERDICT, NOTHING, PARTLY, UNEXPLAINED, Unexplained
from ..numerics.excess import RESIDUAL
from ..show import LOOKS, readable_unit
from .words import chance, number, share, spaced, span

INSTANTS = 200  # at which the evidence so far is told


def headline(d: Diagnosis) -> str:
    """The verdict, the error before and after beside the noise, and what is left: a few sentences."""
    names = []
    for a in d.accepted:
        alike = ", ".join(c.name for c, _ in a.alike)
        names.append(a.candidate.name + (f" (or {alike}: the data do not tell them apart)" if alike else ""))
    missing, unnamed = f"Missing: {listed(names)}{gain_in_words(d)}", dependence(d.unexplained)
    said = {
        FOUND: f"{missing}.",
        NOTHING: f"Nothing is missing that this recording could show{' and that matters' if d.trifle else ''}.",
        PARTLY: f"{missing}; and beyond that {unnamed}, which no name fits.",
        UNEXPLAINED: f"Something is missing that none of the names fits: {unnamed}.",
        NO_VERDICT: f"No verdict: {'; '.join(d.doubts)}.",
    }
    sentences = [said[d.verdict]]
    if inside := [c.name for c in d.inseparable]:
        present = listed([a.candidate.name for a in d.accepted])
        sentences.append(f"Beside {present}, {listed(inside)} would not show: the parameters added do the same.")
    sentences += [error_in_words(d), *further_off(d.errors, d.main)]
    if d.shares and not d.errors[d.main]["excess_before"]["ci95"][0] > 0:
        gained = sum(a.evidence["gain_fitted"] for a in d.accepted)
        sentences.append("Before, there was no error beyond the noise for certain: what was added shows in the "
                         f"log-likelihood of the fitted trials ({gained:+.0f}), not in that error.")  # fmt: skip
    elif d.shares and d.left["value"] is not None:
        each = [f"{a.candidate.name} took off {share(own)}" for a, own in zip(d.accepted, d.shares, strict=True)]
        left = ", ".join(filter(None, [f"{share(d.left)} is left", dependence(d.unexplained or d.trifle)]))
        sentences.append(f"Of the squared error of {spaced(d.main)} beyond the noise, {listed(each)}; {left}.")
    if d.trifle is not None:
        sentences.append(f"Significant but small: {dependence(d.trifle)}, {100 * d.trifle.size:.2g} % of the friction "
                         f"force (diagnose.worth: {100 * d.settings.worth:.2g} %).")  # fmt: skip
    elif d.verdict in (FOUND, NOTHING) and not d.fit.white:
        sentences.append("Yet what the model leaves of the fitted trials is no white noise: signals are filtered, "
                         "something acts that no candidate fits, or a lower minimum was not found.")  # fmt: skip
    looked_at, given = len(d.fitted) + len(d.held_out), sum(len(recording) for recording in d.whole)
    if looked_at < given:
        sentences.append(f"Looked at {looked_at} of {given} samples, in windows spread evenly over the recording "
                         "(diagnose.samples).")  # fmt: skip
    if untested := {r.candidate.name for r in d.refused if "could not be tested" in r.why}:
        sentences.append(f"{len(untested)} candidates could not be tested: their derivatives overflow in the "
                         "simulation.")  # fmt: skip
    return " ".join(sentences)


def dependence(rest: Unexplained | None) -> str:
    """What a remainder is and on which variables it may depend, three at most; empty where there is none."""
    if rest is None:
        return ""
    kind, variables = "friction" if rest.kind == "friction" else "a force", spaced(" or ".join(rest.depends_on[:3]))
    if not rest.confirmed:
        return f"{kind} that goes with {variables} in the fitted trials alone"
    return f"{kind} that depends on {variables}"


def gain_in_words(d: Diagnosis) -> str:
    """What the held-out trials say of the effects: an rms error with much noise in it hardly moves.

    Where the parameters as fitted predict them badly, what they gain once those move within their errors: a static
    friction that the fitted trials leave open makes a slip that comes too late.
    """
    total = gain_together(d)
    if total is None:
        return ""
    moved = ""
    if total < d.settings.gain:
        moved = f", {d.gain_within_errors:+.0f} with parameters moved within their errors"
    return f" (log-likelihood of trials that no fit saw {total:+.0f}{moved})"


def gain_together(d: Diagnosis) -> float | None:
    """Log-likelihood that held-out trials gain by all effects, at the declared model's noise levels; None without."""
    if not d.accepted or not d.scored.startswith("held"):
        return None
    return float(sum(evidence_so_far(d, k)[1][-1] for k in range(len(d.before.models))))


def evidence_so_far(d: Diagnosis, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, s, and the log-likelihood that trial ``k`` gains until then, shape (INSTANTS + 1,) each.

    At the declared model's noise levels, which take what it lacks for noise: never too much.
    """
    loss, sigmas, t = d.bench.problem.loss, d.before.sigmas, d.before.models[k].t
    before, after = (fit.state.pieces[k].residuals for fit in (d.before, d.after))
    gained = np.zeros(INSTANTS)
    for name in before:
        old, new = (np.array_split(np.nan_to_num(r[name] / sigmas[name]), INSTANTS) for r in (before, after))
        gained += [loss.cost(a) - loss.cost(b) for a, b in zip(old, new, strict=True)]
    return np.linspace(t[0], t[-1], INSTANTS + 1), np.concatenate([[0.0], np.cumsum(gained)])


def error_in_words(d: Diagnosis) -> str:
    """The error beyond the noise of the signal quoted first, before and after, and where the noise is known from."""
    entry = d.errors[d.main]
    what = entry["quantity"].removeprefix("rms error")
    old, new = (f"{e['value']:.3g} ({e['ci95'][0]:.3g} to {e['ci95'][1]:.3g})"
                for e in (entry["excess_before"], entry["excess_after"]))  # fmt: skip
    if entry["noise_from"] == RESIDUAL:
        noise = f"the model's own residual is taken for the noise, {entry['noise_floor']:.3g}"
        other = "neighbouring samples differ by"
    else:
        noise, other = f"noise floor {entry['noise_floor']:.3g}, from {entry['noise_from']}", "the model leaves"
    if entry["noise_other"] is not None:
        noise += f" ({other} {entry['noise_other']:.3g}: noise correlated in time, or a model far off)"
    count = entry.get("outliers_left_out")
    noise += f" ({count} outliers left out)" if count else ""
    unit = readable_unit(entry["unit"])
    return f"Error{what} beyond the noise, {d.scored}, {unit}: {old} before, {new} after; {noise}."


def further_off(errors: Mapping[str, Any], main: str) -> list[str]:
    """A sentence on the measured signals not quoted of which the error beyond the noise is larger than the noise, for
    certain: the one quoted, which shows the improvement best, does not show a motion that was lost."""
    others = {name: e for name, e in errors.items() if name != main and not name.endswith(FORCE)}
    far = {name: e for name, e in others.items() if e["excess_after"]["ci95"][0] > e["noise_floor"]}
    each = [f"{spaced(name)} by {e['excess_after']['value']:.3g} {readable_unit(e['unit'])}" for name, e in far.items()]
    return [f"Beside that the model is off by more than the noise: {listed(each)}."] if each else []


def write_page(
    path: Path,
    result: Mapping[str, Any],
    words: str,
    mathml: str,
    figures: Sequence[Path],
    together: float | None = None,
) -> None:
    """Write the report as one HTML file, from ``diagnosis.html``.

    Args:
        result: as in ``result.json``.
        words: see :func:`headline`.
        mathml: the friction force.
        figures: PNG files, embedded under the names of their files.
        together: see :func:`gain_together`.
    """
    images = {p.stem: base64.b64encode(p.read_bytes()).decode() for p in figures}
    page = Template(Path(__file__).with_name("diagnosis.html").read_text(encoding="utf-8"))
    refused: dict[str, list[str]] = {}
    for candidate in result["refused"]:
        refused.setdefault(candidate["why"], []).append(candidate["name"])
    words_of = {"number": number, "span": span, "share": share, "chance": chance, "unit": readable_unit}
    text = page.render(r=result, headline=words, mathml=mathml, images=images, refused=refused, together=together,
                       looks=LOOKS, **words_of)  # fmt: skip
    path.write_text(text, encoding="utf-8")
