"""The report of a diagnosis: one self-contained page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import sympy as sp
from jinja2 import Environment
from sympy.core.alphabets import greeks

from ..physics.base import CONTACT
from ..physics.mechanism import Mechanism

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Diagnosis of {{ model }}</title><style>
body {font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222}
table {border-collapse: collapse; margin: 1rem 0; width: 100%}
th, td {padding: .3rem .7rem; text-align: right; border-bottom: 1px solid #ddd; font-variant-numeric: tabular-nums}
th:first-child, td:first-child, .text {text-align: left !important}
img {max-width: 100%} figcaption, p.note {color: #555; font-size: .9rem} figure {margin: 2rem 0}
.verdict {border-left: 6px solid {{ color }}; padding: .6rem 1rem; background: #f5f6f8; font-size: 1.15rem}
math {font-size: 1.2rem} .equation {overflow-x: auto}
pre {background: #f5f6f8; padding: .6rem; overflow-x: auto; font-size: .8rem}
details {margin: 1rem 0}
</style></head><body>
<h1>{{ r.verdict | capitalize }}</h1>
<p class="verdict">{{ headline }}</p>
<p class="note">Declared: {{ r.model.system }}, friction {{ r.model.friction }}{% if r.model.declared %} with
{{ r.model.declared | join(", ") }}{% endif %}. Fitted to trials {{ r.data.fitted | join(", ") }};
{% if r.data.held_out %}held out, seen by no fit: {{ r.data.held_out | join(", ") }}{% else %}no trial could be held
out: errors are those of the fitted trials{% endif %}. {{ r.declared.outcome | capitalize }}.</p>
{{ figure("error", "Error beyond the noise, before and after, with 95 % intervals.") }}
{{ figure("proof", "A line that climbs: second by second the recording speaks for what was added.") }}
{% if r.effects %}<h2>What was added</h2>
<table><tr><th>effect</th><th>parameter</th><th>value</th><th>95 % interval</th>
<th>share of the squared error beyond the noise that it took off</th>
<th>log10 of the chance to see it by luck</th><th>log-likelihood gained on held-out trials</th>
<th class="text">not told apart from</th></tr>
{% for e in r.effects %}{% for name, p in e.parameters.items() %}<tr><td>{{ e.name if loop.first }}</td>
<td>{{ name }}</td><td>{{ number(p.value) }}{{ " " + p.unit if p.unit != "1" }}</td>
<td>{{ span(p.ci95) }}</td>
<td>{{ share(e.share_of_excess) if loop.first }}</td>
<td>{{ number(e.evidence.log10_p) if loop.first }}</td>
<td>{{ number(e.evidence.gain_held_out) if loop.first and e.evidence.gain_held_out is defined }}</td>
<td class="text">{{ e.indistinguishable_from | join(", ") if loop.first }}</td></tr>{% endfor %}{% endfor %}</table>
{% for e in r.effects %}{% if e.separate %}<p>To tell {{ e.name }} from {{ e.indistinguishable_from | join(", ") }}:
{{ e.separate }}</p>{% endif %}{% endfor %}{% endif %}
{% if r.unexplained %}<h2>What no name fits</h2>
<p>{{ "%.2g" | format(100 * r.unexplained.size) }} % of the friction force{% if r.effects %}; of the squared error
beyond the noise {{ share(r.left) }} is left{% endif %}.
It depends on {{ r.unexplained.depends_on | join(" or ") | replace("_", " ") }}{% if
r.unexplained.share is not none %}, which explains {{ "%.0f" | format(100 * r.unexplained.share) }} %
of the remainder on the held-out trials{% endif %}{% if
r.unexplained.formula %}; in short: {{ r.unexplained.formula }}{{
" of the dry friction" if r.unexplained.unit == "1" else " " + r.unexplained.unit }}{% endif %}.</p>
{% if r.unexplained.network %}<p>A network of {{ r.unexplained.network.depends_on | replace("_", " ") }} in its place,
trained together with all parameters: {{ r.unexplained.network.error.quantity }}
{{ number(r.unexplained.network.error.before) }} before, {{ number(r.unexplained.network.error.after) }} after,
{{ number(r.unexplained.network.error.noise_floor) }} {{ r.unexplained.network.error.unit }} noise. It is part of the
saved model; no more is known of it than the variable.</p>{% endif %}
{{ figure("remainder", "The remainder over the variable that explains most of it.") }}{% endif %}
<h2>The friction force</h2>
<div class="equation">{{ mathml }}</div>
<details><summary>LaTeX</summary><pre>{{ r.equation | e }}</pre></details>
<h2>Parameters before and after</h2>
<table><tr><th>parameter</th><th>declared model</th><th>95 % interval</th><th>augmented model</th>
<th>95 % interval</th></tr>
{% for name, p in r.parameters.items() %}<tr><td>{{ name }}{{ " (" + p.unit + ")" if p.unit != "1" }}</td>
<td>{{ number(p.before.value) if p.before }}</td>
<td>{{ span(p.before.ci95) if p.before }}</td>
<td>{{ number(p.value) }}</td><td>{{ span(p.ci95) }}</td></tr>{% endfor %}</table>
<h2>Error before and after, {{ r.error.on }}</h2>
<table><tr><th>quantity</th><th>beyond the noise, before</th><th>after</th><th>rms before</th><th>after</th>
<th>noise</th><th class="text">known from</th></tr>
{% for e in r.errors.values() %}<tr><td>{{ e.quantity }} ({{ e.unit }}){{
", %d outliers left out" | format(e.outliers_left_out) if e.outliers_left_out }}</td>
{% for told in (e.excess_before, e.excess_after) %}<td>{{ number(told.value) }}<br><small>{{ span(told.ci95) }}</small>
</td>{% endfor %}<td>{{ number(e.before) }}</td><td>{{ number(e.after) }}</td><td>{{ number(e.noise_floor) }}{{
" or " + number(e.noise_other) if e.noise_other is not none }}</td>
<td class="text">{{ e.noise_from }}</td></tr>{% if e.relative %}
<tr><td>the same, relative</td><td></td><td></td>
<td>{{ "%.2f" | format(100 * e.relative.before) }} %</td><td>{{ "%.2f" | format(100 * e.relative.after) }} %</td>
<td>{{ "%.2f" | format(100 * e.relative.noise_floor) }} %</td><td></td></tr>{% endif %}{% endfor %}</table>
<p class="note">Beyond the noise: the square root of the mean squared error less the squared noise, with the 95 %
interval of a bootstrap over blocks of several correlation times of the residual
({{ "%.2g" | format(r.error.block_s) }} s for the signal quoted first).{% if far %} Two levels of noise: what
neighbouring samples differ by, and what the model leaves; they lie far apart where the noise is correlated in time, or
the model far off.{% endif %}</p>
{{ figure("residual", "Model minus measurement. What stays within the band is noise.") }}
{{ figure("dependence", "Bars beyond the dashed line: the residual still depends on that variable.") }}
<h2>What was tried</h2>
{{ figure("tried", "Score tests at the declared model, every value of hidden parameters that was tried counted.") }}
<details open><summary>{{ r.refused | length }} candidates refused, and why</summary>
<table><tr><th>candidate</th><th class="text">why</th></tr>
{% for c in r.refused %}<tr><td>{{ c.name }}</td><td class="text">{{ c.why }}</td></tr>{% endfor %}</table></details>
<p class="note">Noise: {% for name, s in r.noise.items() %}{{ name }} {{ number(s.value) }} {{ s.unit }}{{ ", " if not
loop.last }}{% endfor %}{% if r.coloured %}; correlated in time: {{ r.coloured | join(", ") }}{% endif %}.
Loss: {{ r.loss }}. {{ "%.0f" | format(r.seconds) }} s.</p>
</body></html>
"""
LETTERS = {*greeks, "zdot"}  # first parts of names that are letters
_COLORS = {"effect found": "#d1495b", "nothing missing": "#2a9d8f", "partly explained": "#d9722e",
           "unexplained": "#e9a03b"}  # fmt: skip


def number(value: float | None) -> str:
    """Four significant digits."""
    return "?" if value is None else f"{value:.4g}"


def span(ci95: Sequence[float | None]) -> str:
    """A 95 % interval in words."""
    return "not told by these data" if None in ci95 else f"{number(ci95[0])} to {number(ci95[1])}"


def share(told: Mapping[str, Any]) -> str:
    """A share with its 95 % interval, in per cent."""
    if told["value"] is None:
        return "?"
    value, low, high = (f"{100 * x:.0f}" for x in (told["value"], *told["ci95"]))
    return f"{value} % ({low} to {high} %)"


def write_page(path: Path, result: Mapping[str, Any], headline: str, mathml: str, figures: Sequence[Path]) -> Path:
    """Write the report."""
    images = {p.stem: base64.b64encode(p.read_bytes()).decode() for p in figures}

    def figure(name: str, caption: str) -> str:
        if name not in images:
            return ""
        return (f'<figure><img alt="{caption}" src="data:image/png;base64,{images[name]}">'
                f"<figcaption>{caption}</figcaption></figure>")  # fmt: skip

    page = Environment().from_string(_PAGE)
    text = page.render(
        r=result, headline=headline, mathml=mathml, figure=figure, number=number, span=span,
        share=share,
        color=_COLORS[result["verdict"]], far=any(e["noise_other"] is not None for e in result["errors"].values()),
        model=f"{result['model']['system']}, {result['model']['friction']}",
    )  # fmt: skip
    path.write_text(text, encoding="utf-8")
    return path


def equation(mechanism: Mechanism) -> sp.Eq:
    """Friction force of the law and its effects as the contact sees them: velocity v, normal force N, bristle z."""
    seen = mechanism._seen
    force = sp.sympify(mechanism.law.force(seen, mechanism.law.symbols))
    force += sum(e.force(seen, mechanism.p, mechanism.law) for e in mechanism.effects)
    short = {CONTACT.v: sp.Symbol("v"), CONTACT.zdot: sp.Symbol("zdot"), CONTACT.s: sp.Symbol("s"),
             CONTACT.a: sp.Symbol("a")}  # fmt: skip
    return sp.Eq(sp.Symbol("F"), force.xreplace(short), evaluate=False)


def in_latex(e: sp.Eq) -> str:
    """LaTeX, names that are words upright and whole: low_speed is no product, and no l with an index."""
    words = {s: s.name for s in e.free_symbols if len(first := s.name.split("_")[0]) > 1 and first not in LETTERS}
    names = {s: rf"\mathrm{{{name}}}".replace("_", r"\_") for s, name in words.items()}
    return sp.latex(e, mul_symbol="dot", symbol_names=names)


def in_mathml(e: sp.Eq) -> str:
    """A block of MathML."""
    return f'<math display="block">{sp.mathml(e, printer="presentation", mul_symbol="dot")}</math>'


def rate_equation(mechanism: Mechanism) -> sp.Eq | None:
    """z' where there is a bristle."""
    if not mechanism.memory:
        return None
    seen = mechanism._seen
    if mechanism.law.memory:
        rate = mechanism.law.bristle_rate(seen, mechanism.law.symbols)
    else:
        rate = next(e for e in mechanism.effects if e.memory).bristle_rate(seen, mechanism.p, mechanism.law)
    short = {CONTACT.v: sp.Symbol("v"), CONTACT.s: sp.Symbol("s"), CONTACT.a: sp.Symbol("a")}
    return sp.Eq(sp.Symbol("zdot"), sp.sympify(rate).xreplace(short), evaluate=False)
