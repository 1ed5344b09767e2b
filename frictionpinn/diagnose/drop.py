"""Effects that are taken out of a model again because the fit is as good without them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .bench import NEAR, Bench, tried
from .contest import Accepted, Refused, Settings, needed
from .fit import Fit
from .scan import scan
from .tries import add, better

if TYPE_CHECKING:
    from .select import Selection

HOPEFUL = 0.5  # of what an effect gained: a fit without it that still loses more after a short try is given up


def drop(bench: Bench, selection: Selection, settings: Settings) -> bool:
    """Take out effects without which the fit is as good from where it is now.

    Those that came first may not be needed beside later ones; and the last may have gained nothing but a way out of a
    wrong minimum. Says whether there were any.
    """
    before = tuple(selection.accepted)
    for accepted in before:
        own = {*accepted.candidate.strengths, *accepted.candidate.hidden}
        others = {
            n for a in selection.accepted if a is not accepted for n in (*a.candidate.strengths, *a.candidate.hidden)
        }
        names = tuple(n for n in selection.fit.names if n not in own - others)
        found = _without(bench, selection, accepted, names, settings)
        if found is not None and found.state.cost - selection.fit.state.cost < needed(accepted.tested, settings):
            loss = found.state.cost - selection.fit.state.cost
            selection.refused.append(
                Refused(accepted.candidate, f"not needed in the end ({loss:+.1f} in log-likelihood without it)")
            )
            selection.fit = found
            selection.accepted.remove(accepted)
            if not selection.accepted:
                selection.base = found
    return len(selection.accepted) < len(before)


def _without(
    bench: Bench, selection: Selection, accepted: Accepted, names: Sequence[str], settings: Settings
) -> Fit | None:
    """The fit without an effect, from where the quadratic model sees its minimum, from where it is now and, with one
    other, from where that is found anew.

    A long ripple and a spring make the force of another spring between them: without the ripple its place is elsewhere.
    """
    fit, others = selection.fit, [a.candidate for a in selection.accepted if a is not accepted]
    gone = [n for n in accepted.candidate.strengths if n not in names]
    here = fit.values | dict.fromkeys(gone, 0.0)
    there = bench.without(fit, gone, [n for n in accepted.candidate.hidden if n not in names])
    near = fit.state.cost + max(NEAR, HOPEFUL * accepted.evidence["gain_fitted"])
    found = [tried(bench, there, names, there.values, near)]
    if found[0] is not None and found[0].state.cost - fit.state.cost < needed(accepted.tested, settings):
        return found[0]
    found.append(tried(bench, fit, names, here, near))
    if len(others) == 1:
        (other,) = others
        own = {*other.strengths, *other.hidden}
        values = here | dict.fromkeys(other.strengths, 0.0)
        bare = bench.refit(fit, tuple(n for n in names if n not in own), values, iterations=0)
        found += (
            [] if bare is None else [add(bench, bare, scan(bench, bare, [other], (), {}).tested[0], thorough=False)]
        )
    return better(*found)
