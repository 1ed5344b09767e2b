"""Recordings: read, simulated, checked."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import OmegaConf

from ..data.noise import GaussianNoise, Noise
from ..data.recording import Recording
from ..data.simulated import check_truth, simulate_trials
from ..errors import UserError, nearest
from ..physics import System
from ..physics.contacts import by_parameter
from ..physics.mechanism import Mechanism
from ..show import Shown, Table, readable_unit
from ..workflow.build import build_recording
from ..workflow.configs import CONF
from ..workflow.vet import assumptions, findings_of, in_words
from .arguments import mechanism_given, number_given, recording_given, seed_given, table_given
from .models import made_system

Paths = str | os.PathLike | Iterable[str | os.PathLike]
# Of conf/data/csv.yaml what is read.
READING = ("columns", "units", "gains", "trial_column", "delimiter", "decimal", "rate_hz", "max_samples")


def read(path: Paths, system: System | str, **options: Any) -> Recording:
    """Read a recording of a system: each trial's time, s, and signals, arrays of shape (n,), SI units.

    Args:
        path: a file, a folder, a pattern or a list of these: .csv, .csv.gz, .txt, .tsv, .parquet, .mat, .npz.
        system: what was recorded, or its name; its signals are the names that columns are read as.
        options: as in conf/data/csv.yaml: ``columns={"x": "pos"}``, ``units={"x": "mm", "default": "SI"}`` (without
            them all are in SI), ``gains``, ``trial_column`` (None: each file is a trial), ``delimiter``, ``decimal``,
            ``rate_hz``, ``max_samples``.

    Raises:
        UserError: what the file lacks or holds that cannot be: columns, units, values, time.

    Examples:
        >>> import frictionpinn as fp
        >>> drive = fp.system("drive", M=2.0)
        >>> log = fp.simulate(fp.mechanism(drive, "coulomb"), {"mu_c": 3.0}, [{"duration": 1, "force": "5*sin(8*t)"}])
        >>> fp.read(log.save("drive.csv"), drive).names
        ['1']
    """
    defaults: dict[str, Any] = OmegaConf.load(CONF / "data" / "csv.yaml").data  # type: ignore[assignment]
    cfg = {str(key): value for key, value in OmegaConf.to_container(defaults).items() if key != "path"}  # type: ignore[arg-type, union-attr]
    for key in options:
        if key not in READING:
            fix = (
                f"give {key} to the function that it is for, such as fp.diagnose"
                if key in cfg
                else nearest(key, READING)
            )
            raise UserError("unknown option", where="read", received=key, allowed=", ".join(READING),
                            fix=fix or "use one of the allowed names")  # fmt: skip
    paths = [path] if isinstance(path, str | os.PathLike) else path
    if not isinstance(paths, list | tuple) or not paths or not all(isinstance(x, str | os.PathLike) for x in paths):
        raise UserError("not a file", where="read", received=type(path).__name__, allowed="a path, or a list of paths",
                        fix="write a table to a file first, table.to_csv(...)")  # fmt: skip
    where = {"path": [os.fspath(item) for item in paths]}
    return build_recording(cfg | options | where, made_system(system, "read"))


def simulate(
    mechanism: Mechanism,
    truth: Mapping[str, float],
    trials: Sequence[Mapping[str, Any]],
    *,
    rate_hz: float = 400.0,
    noise: float | Noise = 0.0,
    seed: int = 0,
) -> Recording:
    """Simulate trials of a mechanism, as its sensors would record them.

    Args:
        mechanism: system, friction law and effects.
        truth: parameters of the law and the effects by name, SI units.
        trials: a table for each: ``duration``, s; an expression of time such as ``"5*sin(2*pi*t)"`` for every input and
            driven coordinate (its position); optionally ``initial``, ``constants``, ``name``, ``start``.
        rate_hz: samples per second.
        noise: Gaussian, standard deviation relative to that of each signal; or a model of frictionpinn.data.noise.
        seed: of the noise.

    Returns:
        A recording whose trials hold positions, velocities, accelerations and inputs, shape (n,), and in ``truth`` the
        friction force, N or N m.

    Raises:
        UserError: an unknown signal or parameter, a value out of range, contact lost.

    Examples:
        >>> import frictionpinn as fp
        >>> model = fp.mechanism("drive", "coulomb_viscous")
        >>> trial = {"duration": 1.0, "force": "5*sin(2*pi*t)"}
        >>> fp.simulate(model, {"mu_c": 3.0, "sigma_2": 1.0}, [trial], rate_hz=100)
        simulated drive+coulomb_viscous: 100 samples of 1 trial
          trial  samples  length (s)  rate (Hz)
          1      100      0.99        100
          signal  unit  smallest  largest
          force   N     -5        5
          x       m     0         0.08387
          v       m/s   -0.3374   0.3374
          a       m/s²  -4.254    2.876
    """
    mechanism = mechanism_given(mechanism)
    values = by_parameter(table_given(truth, "truth"), mechanism.law)
    check_truth(mechanism, values)
    clean = simulate_trials(mechanism, values, trials, number_given(rate_hz, "rate_hz", least=0.0))
    return (noise if isinstance(noise, Noise) else GaussianNoise(number_given(noise, "noise")))(clean, seed_given(seed))


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """What was found in a recording before anything is learned from it.

    Attributes:
        recording, system: what was checked, and what it is said to be of.
        findings: what speaks against it, a sentence each: "wrong: ..." is refused by a fit, "odd: ..." is not; none
            where nothing does.
    """

    recording: Recording
    system: System
    findings: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing speaks against the recording."""
        return not self.findings

    @property
    def assumptions(self) -> list[str]:
        """Parameters in force, signals used, derived and taken as zero, what was mended, a sentence each."""
        return assumptions(self.system, self.recording)

    def tables(self) -> list[Table]:
        """Findings, and every signal of the system: where it comes from."""
        present = set().union(*(trial.signals for trial in self.recording.trials))
        units = {name: unit for name, unit in self.system.signal_units.items() if name != "t"}
        rows = [(n, readable_unit(u), "recorded" if n in present else "missing: derived, or not compared")
                for n, u in units.items()]  # fmt: skip
        notes = (*(self.findings or ("nothing speaks against this recording",)), *self.assumptions)
        return [Table(("signal", "unit", ""), tuple(rows), f"check of {self.recording.source}", notes)]

    def figures(self) -> dict[str, Any]:
        """The signals."""
        return self.recording.figures()

    def to_dict(self) -> dict[str, Any]:
        """Findings and assumptions."""
        return {"ok": self.ok, "findings": list(self.findings), "assumptions": self.assumptions,
                "system": self.system.name, "parameters": dict(self.system.values)}  # fmt: skip


def check(recording: Recording, system: System | str) -> Check:
    """Check a recording before anything is learned from it: what is assumed, and what speaks against it.

    Args:
        recording: SI units.
        system: what it is said to be of.

    ``fit``, ``diagnose``, ``online`` and ``train`` do it, too, and refuse what is wrong.

    Examples:
        >>> import frictionpinn as fp
        >>> drive = fp.system("drive", M=2.0)
        >>> log = fp.simulate(fp.mechanism(drive, "coulomb"), {"mu_c": 3.0}, [{"duration": 1, "force": "5*sin(8*t)"}])
        >>> fp.check(log, drive).ok
        True
    """
    made, recording = made_system(system, "check"), recording_given(recording)
    return Check(recording, made, tuple(in_words(finding) for finding in findings_of(made, recording)))
