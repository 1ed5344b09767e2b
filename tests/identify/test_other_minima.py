"""For how long other minima are looked for around one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.identify import explore as exploring

SAMPLES = 1000


def solution(cost: float):
    piece = SimpleNamespace(residuals={"v": np.zeros(SAMPLES)})
    return SimpleNamespace(state=SimpleNamespace(cost=cost, pieces=(piece,)), reason="converged")


@pytest.mark.parametrize(
    ("cost", "gain", "rounds"),
    [
        (SAMPLES / 2 + 5, 2.0, exploring.ROUNDS),  # as good as noise: units of log-likelihood count
        (SAMPLES / 2 + 5, 0.9, 1),
        (10_000.0, 500.0, 1),  # something is missing: what takes off a twentieth of that is not worth a round
        (10_000.0, 1500.0, exploring.ROUNDS),
    ],
)
def test_restarts_go_on_while_they_gain_much_of_what_is_left_beyond_noise(monkeypatch, cost, gain, rounds):
    made = []

    def descend(evaluate, first, limits, rival, visited):
        made.append(rival)
        return solution(rival - gain)

    monkeypatch.setattr(exploring, "_around", lambda *a: [(np.zeros(1), [])])
    monkeypatch.setattr(exploring, "returned", lambda best: lambda state: False)
    monkeypatch.setattr(exploring, "descend", descend)
    minima = exploring.explore(lambda *a, **k: object(), solution(cost), (np.zeros(1), np.ones(1)))
    assert len(made) == rounds
    assert minima[0].state.cost == pytest.approx(cost - rounds * gain)
