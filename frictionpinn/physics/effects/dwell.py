"""Static friction that grows while the contact rests."""

import sympy as sp

from ..effect import Effect, State, hidden, strength
from ..scan import Scan


class Dwell(Effect):
    """The law sees N (1 + dwell age / dwell_length), age' = (dwell_length - age) / dwell_time - |v| age / dwell_length.

    At rest the age rises to dwell_length with the time constant dwell_time; slip over dwell_length wipes it out. It
    starts where it rests at the initial velocity. (A rate-and-state law whose growth is bounded.)

    Units: dwell dimensionless, age and dwell_length in the unit of slip, dwell_time in seconds. A law that creeps at
    rest (v_t) needs dwell_length above v_t dwell_time.
    Neutral: dwell = 0.
    Occurs: in boundary lubrication, with rubber and rock, wherever contacts creep or bonds form.
    Experiment: breakaway after rests of different lengths.
    """

    name = "dwell"
    states = (State("age", "{L}"),)
    parameters = (
        strength("dwell", "1", "share by which dry friction grows at rest", 0.0),
        hidden("dwell_time", "s", "time constant of the growth", 0.1, Scan("duration", 0.01, 1.0, 5)),
        hidden("dwell_length", "{L}", "slip that wipes it out", 1e-4, Scan("stroke", 1e-3, 0.1, 3)),
    )

    def state_rates(self, c, p):
        (age,) = self.states
        return ((p.dwell_length - age.symbol) / p.dwell_time - sp.Abs(c.v) * age.symbol / p.dwell_length,)

    def load(self, N, c, p):
        return N * (1 + p.dwell * self.states[0].symbol / p.dwell_length)
