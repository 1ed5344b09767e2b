"""Diagnosis of a declared model: fit, residual, trace, augment, proof on held-out trials, a plain word on the rest."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..data.recording import Recording
from ..identify.problem import simulated_alone
from ..identify.result import Estimate
from ..physics.effects import effects_for
from ..physics.mechanism import Mechanism
from ..physics.remainder import remainders
from ..show import Shown, Table, estimated, interval, readable_unit
from .bench import Bench
from .candidates import Candidate, candidates, scales
from .errors import main_signal
from .held_out import surprise
from .select import Accepted, Refused, Selection, Settings, intervals, select
from .verdict import NO_VERDICT, Network, Verdict, gate, judge, train_network

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)

INSEPARABLE = "would not show beside the effects that were added: it acts as their parameters do"


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown, Verdict):
    """What a declared model lacks, beside its :class:`frictionpinn.diagnose.verdict.Verdict`.

    Attributes:
        accepted: effects that were added, in order.
        refused: candidates with a reason.
        values: name -> estimate of the augmented model, SI units; ``ci95`` its 95 % intervals (NaN
            where the data do not tell it), ``units`` its units.
        declared: the declared model's estimate.
        noise: signal -> noise standard deviation, SI units.
        coloured: signals whose noise is correlated in time.
        seconds: wall-clock time.
        settings: thresholds.
        network: the fallback term in the place of what no name explains, if it was asked for.
        fitted: the trials that were fitted.
        whole: fitted and held-out trials as given: more than were looked at where they are longer than
            ``settings.samples``.
        config: the options of the diagnosis, for its report.
        doubts: what keeps the verdict from having a sense, see :func:`frictionpinn.diagnose.verdict.gate`; the verdict
            then is "no verdict".
    """

    most_rows = None

    accepted: tuple[Accepted, ...]
    refused: tuple[Refused, ...]
    values: dict[str, float]
    ci95: dict[str, tuple[float, float]]
    units: dict[str, str]
    declared: Estimate
    noise: dict[str, float]
    coloured: tuple[str, ...]
    seconds: float
    settings: Settings
    bench: Bench
    selection: Selection
    network: Network | None = None
    fitted: Recording = field(default_factory=lambda: Recording((), {}))
    whole: tuple[Recording, ...] = ()
    config: dict[str, Any] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()

    @property
    def held_out(self) -> Recording:
        """The trials that no fit saw."""
        return self.bench.held_out

    @property
    def inseparable(self) -> list[Candidate]:
        """What might act beside the effects that were added and would be part of them: it moves all that is measured as
        their parameters do. A constant force beside a spring only shifts where that is relaxed."""
        return [r.candidate for r in self.refused if r.why == INSEPARABLE]

    @property
    def main(self) -> str:
        """The signal by which the error is quoted first: that which shows the improvement best."""
        return main_signal(self.bench.mechanism.system, self.errors)

    @cached_property
    def gain_within_errors(self) -> float:
        """Log-likelihood that the held-out trials gain where the parameters may move within their errors."""
        after = replace(self.selection.fit, sigmas=self.selection.base.sigmas)
        old, new = (surprise(self.bench, fit) for fit in (self.selection.base, after))
        return 0.0 if old is None or new is None else old.moved - new.moved

    # how it shows itself ---------------------------------------------------------------------------------------
    def tables(self) -> list[Table]:
        """The verdict in words, and the parameters of the augmented model beside those of the declared one."""
        from ..report.diagnosis import headline

        before = {name: self.declared.values[name] for name in self.declared.names}
        rows = [(n, estimated(value, self.ci95[n]), readable_unit(self.units[n]), interval(self.ci95[n]), before.get(n))
                for n, value in self.values.items()]  # fmt: skip
        return [Table(("parameter", "value", "unit", "95 % interval", "as declared"), tuple(rows),
                      f"{self.verdict}: {headline(self)}")]  # fmt: skip

    def figures(self) -> dict[str, Figure]:
        """Errors before and after, residuals, what was tried, and what is left."""
        from ..report.diagnosis_figures import figures

        return figures(self)

    def to_dict(self) -> dict[str, Any]:
        """What stands in ``result.json``."""
        from ..workflow.diagnose import as_dict

        return as_dict(self)

    def save(self, folder: str | Path) -> Path:
        """Write ``result.json``, figures, the page ``report.html`` and ``augmented.yaml``, as the command does.

        The recording is written beside them, ``recording.parquet``, so that the augmented model can be trained on it.
        """
        from ..workflow.diagnose import report

        folder = Path(folder)
        fitted, held_out = self.whole
        whole = replace(fitted, trials=(*fitted.trials, *held_out.trials))
        own = {"name": "csv", "path": str(whole.save(folder / "recording.parquet").absolute()), "trial_column": "trial"}
        report(self, self.config | {"data": own | {"held_out": list(held_out.names)}}, folder)
        return folder


def diagnose(
    mechanism: Mechanism,
    fitted: Recording,
    held_out: Recording | None = None,
    *,
    effects: Sequence[str] | None = None,
    settings: Settings | None = None,
    start: Mapping[str, float] | None = None,
    network: bool = False,
    **options: Any,
) -> Diagnosis:
    """Find what a declared model lacks in a recording.

    Args:
        mechanism: the declared model: a system, a friction law, and effects that are declared already.
        fitted: trials to fit.
        held_out: trials that no fit sees: an effect is kept only if they improve.
        effects: names of the effects to try; None: all that can act.
        settings: thresholds.
        start: start values of parameters, SI units.
        network: train a network in the place of a remainder that no name explains.
        options: of :class:`frictionpinn.identify.Problem` (free, fixed, bounds, windows, inputs, loss ...).

    Raises:
        UserError: the declared model cannot be fitted; names or signals that do not fit it.
    """
    began, settings = time.perf_counter(), settings or Settings()
    whole = fitted, held_out or Recording((), fitted.units)
    fitted, held_out = _looked_at(whole, settings.samples, options.get("windows"))
    system, law = mechanism.system, mechanism.law
    kinds, given = effects_for(system, law, effects), {e.name for e in mechanism.effects}
    bench = Bench(mechanism, kinds, remainders(system), fitted, held_out, start, **options)
    declared = {par.name for e in mechanism.effects for par in e.parameters_on(system, law)}
    options_ = candidates(kinds, system, law, scales(system, bench.runs))
    options_ = tuple(replace(c, hidden=(), grid=({},)) if c.effect in given else c
                     for c in options_ if not declared & set(c.strengths))  # fmt: skip
    log.info(f"{len(options_)} candidates of {len({c.effect for c in options_})} effects, "
             f"{sum(len(c.grid) for c in options_)} shapes")  # fmt: skip
    selection = select(bench, options_, settings)
    verdict = judge(bench, selection, settings)
    fit, scanned = verdict.fit, verdict.scanned
    accepted = tuple(selection.accepted) if fit is selection.fit else ()
    refused = _reasons(selection, options_, accepted, settings)
    values, ci95 = intervals(bench, fit, scanned)
    fallback = train_network(bench, fit, scanned) if network and verdict.unexplained else None
    if doubts := tuple(gate(bench, accepted, values, ci95)):
        verdict = replace(verdict, verdict=NO_VERDICT)
    return Diagnosis(
        **vars(verdict), accepted=accepted, refused=refused, values=values, ci95=ci95,
        units={name: bench.tested.read_in[name] for name in fit.names}, declared=bench.estimate, noise=scanned.sigmas,
        coloured=scanned.noise.coloured, seconds=time.perf_counter() - began, settings=settings, bench=bench,
        selection=selection, network=fallback, fitted=fitted, whole=whole, doubts=doubts,
    )  # fmt: skip


def _looked_at(whole: Sequence[Recording], most: int, length_s: float | None) -> list[Recording]:
    """The recordings, or as much of each as makes about ``most`` samples together: windows spread evenly over it."""
    total = sum(len(recording) for recording in whole)
    if total <= most:
        return [*whole]
    log.info(f"about {most} of {total} samples are looked at, in windows spread evenly (diagnose.samples)")
    return [r.spread(most / total, simulated_alone(r, length_s)) if r.trials else r for r in whole]


def _reasons(
    selection: Selection, options: Sequence[Candidate], accepted: Sequence[Accepted], settings: Settings
) -> tuple[Refused, ...]:
    """Every candidate that was not added, with why."""
    taken = {a.candidate.name for a in accepted}
    result = {name: r for name, r in selection.refused.items() if name not in taken}
    weak = [a.candidate for a in selection.accepted if a.candidate.name not in taken]
    result |= {c.name: Refused(c, "takes off less than a fifth of the squared error beyond the noise") for c in weak}
    final = {t.candidate.name: t for t in selection.last.tested}
    first = {t.candidate.name: t for t in selection.first.tested}
    for c in options:
        if c.name in taken or c.name in result:
            continue
        t, early = final.get(c.name), first.get(c.name)
        if t is None:
            result[c.name] = Refused(c, "beside the effects that were added nothing is left for it")
        elif t.untested:
            result[c.name] = Refused(c, "could not be tested: its derivatives overflow in the simulation")
        elif t.freedom == 0:
            within = accepted and early is not None and early.freedom > 0
            why = INSEPARABLE if within else "acts not at all in this recording, or as what is estimated already"
            result[c.name] = Refused(c, why)
        elif t.log_p + np.log10(len(options)) > settings.log_p:
            explained = early is not None and early.log_p + np.log10(len(options)) < settings.log_p and accepted
            why = "explained by the effects that were added" if explained else "not significant"
            degrees = f"{t.freedom} degree{'s' if t.freedom > 1 else ''} of freedom"
            result[c.name] = Refused(c, f"{why} (statistic {t.statistic:.1f}, {degrees})")
        else:
            result[c.name] = Refused(c, "significant, but other candidates explain it better or no more are added")
    return tuple(result.values())
