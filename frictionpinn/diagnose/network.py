"""A network in the place of what no name explains: one hidden layer of radial units, trained through the equation of
motion together with all parameters of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .bench import Bench
from .errors import compare
from .evidence import check
from .fit import Fit
from .remainder import Remainder
from .rows import on_probe
from .scan import Remaining


@dataclass(frozen=True)
class Network:
    """The fallback term F_net(x) = sum_k w_k exp(-(x - x_k)^2 / h^2), or the law seeing the load N (1 + that sum).

    A black box on what remains: no more is known of it than the variable x that it depends on. It is one of the
    project's symbolic effects, so that the model with it is simulated, differentiated, saved and folded like any other.

    Attributes:
        effect: the term, as an effect.
        kind: "force", w in the system's unit of force; or "friction", w a share of the dry friction.
        values: weights and the units' places by name, SI units.
        fit: of all parameters and weights together.
        errors: before it and after, see :func:`frictionpinn.diagnose.errors.compare`.
    """

    effect: Remainder
    kind: str
    values: dict[str, float]
    fit: Fit
    errors: dict[str, dict]


def train_network(
    bench: Bench,
    fit: Fit,
    remaining: Sequence[Remaining],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    sigmas: Mapping[str, float],
) -> Network | None:
    """Train the network on the variable with the most significant remainder; None where no fit succeeds.

    Args:
        bench: fits.
        fit: the model that leaves the remainder.
        remaining: what is left, the most significant first.
        remainders: the terms by variable.
        places: where the radial units lie.
        sigmas: noise standard deviations, SI units.
    """
    best = remaining[0]
    effect = next(r for r in remainders if r.variable == best.variable)
    names, start = best.names, on_probe(bench, fit, places)
    steps = dict(zip(names, best.coefficients, strict=True))
    tried = [bench.refit(start, (*fit.names, *names), start.values | init) for init in ({}, steps)]
    found = min((f for f in tried if f is not None), key=lambda f: f.state.cost, default=None)
    if found is None:
        return None
    before, after = check(bench, start), check(bench, found)
    pair = (start, found) if before is None or after is None else (before, after)
    own = {name: found.values[name] for name in (*names, *effect.place)}
    return Network(effect, best.kind, own, found, compare(bench, *pair, dict(sigmas)))
