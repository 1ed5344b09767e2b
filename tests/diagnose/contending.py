"""Stubs of fits, candidates and the bench, for the tests of which candidates are refitted and searched."""

from __future__ import annotations

from collections import defaultdict
from types import SimpleNamespace

import numpy as np

from frictionpinn.diagnose import minima, refits, rivals, simpler
from frictionpinn.diagnose.candidates import Candidate


def fit(cost: float, correlation: float = 50.0):
    """A stub of a fit: what remains of it is noise where its correlation is below 4.5."""
    return SimpleNamespace(
        names=("mu_c",), values=defaultdict(float, mu_c=0.3), count=1000, state=SimpleNamespace(cost=cost, locals=()),
        correlation=correlation, explains=correlation < 4.5, minima=(), searched=False, starts=(), locals=(),
    )  # fmt: skip


def option(effect: str, trace: int = 0, statistic: float = 0.0):
    own = np.eye(40)[trace]
    return SimpleNamespace(
        candidate=Candidate(effect, effect, (effect,), bends=effect == "stribeck_shape"),
        beside=None, short=None, untested=False, trace=own, shape={}, statistic=statistic, step={},
    )  # fmt: skip


def contest_stub(monkeypatch):
    """What was refitted and what was searched; ``found`` tells the fit of each candidate, ``better`` a search's."""
    seen = SimpleNamespace(refitted=[], searched=[], found={}, better={})

    def add(bench, before, t, thorough=True, **options):
        seen.refitted.append(t.candidate.effect)
        return seen.found[t.candidate.effect]

    def search(found):
        seen.searched.append(found)
        return seen.better.get(id(found)) or SimpleNamespace(**(vars(found) | {"searched": True}))

    seen.bench = SimpleNamespace(
        mechanism=SimpleNamespace(memory=True),
        search=search,
        refit=lambda *a, **k: None,
        clip=dict,
        problem=None,
        sizes=None,
    )
    for module in (refits, minima):
        monkeypatch.setattr(module, "add", add)
    monkeypatch.setattr(refits, "lifted", lambda *a: None)
    for module in (refits, rivals, simpler):
        monkeypatch.setattr(module, "replace", lambda item, **changes: SimpleNamespace(**(vars(item) | changes)))
    return seen


def names(fits):
    return [t.candidate.effect for t, _ in fits]
