"""The public sets as recordings in SI units, prepared the way that is customary for each.

Where it is not known in which order and after which pauses trials were recorded, each is a session of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frictionpinn.data.prepare import differentiate, prepare_trial, thin
from frictionpinn.data.public import BRFD_COLUMNS, BRFD_TENSION_LB, DATASETS, fetch, read_brfd
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.units import to_si
from frictionpinn.errors import UserError, choose

FIT: dict[str, tuple[str, ...]] = {
    "emps": ("fit",),
    "multiarm_pendulum": ("id_1", "id_2", "id_3", "id_4"),
    "brfd": ("0.25Hz_30lb_0.5in", "0.25Hz_30lb_1.5in", "0.5Hz_30lb_1in", "1Hz_30lb_0.5in"),
    "ur10e": ("50sec", "30sec", "unloaded", "loaded[0]"),
}
HELD_OUT: dict[str, tuple[str, ...]] = {
    "emps": ("pulses",),
    "multiarm_pendulum": ("vad_1", "vad_2", "raw"),
    "brfd": (
        "0.25Hz_30lb_1in",
        "0.5Hz_30lb_0.5in",
        "0.5Hz_30lb_1.5in",
        "1Hz_30lb_1in",
        "1Hz_30lb_1.5in",
        "2Hz_30lb_0.5in",
    ),
    "ur10e": ("40sec", "ptp", "loaded[1]"),
}
# Rows that the authors use, and the gains by which they turn currents into torques, N m/A.
UR10E_ROWS = {"50sec": (355, 5090), "30sec": (635, 3510), "40sec": (500, 4460), "ptp": (700, 4200),
              "unloaded": (300, 4700), "loaded": (300, 4700)}  # fmt: skip
UR10E_GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)
# Periods of a low-pass's cutoff from an end of a run in which it shows more than a thousandth of what that was padded
# with: the slowest poles of a 4th-order Butterworth decay as exp(-2.4 f t).
PADDED = 3.0
LEAST_CUTOFF_HZ = 2.0  # of the pendulum, whose swings of 1.2 Hz must pass


def load_emps(
    cutoff_hz: float | None = 100.0, rate_hz: float | None = 80.0, thin_cutoff_hz: float | None = None
) -> Recording:
    """Load the ball-screw drive EMPS: trials "fit" and "pulses".

    Args:
        cutoff_hz: zero-phase low-pass of the position before it is differentiated, Hz.
        rate_hz: rate after low-pass and decimation of all signals, Hz. None keeps the recorded 1 kHz and leaves force
            and reference unfiltered, for a regression that passes both sides through
            :func:`frictionpinn.data.prepare.decimate` itself.
        thin_cutoff_hz: low-pass before decimation, Hz; None takes that of ``decimate``.

    Returns:
        Signals x, x_ref (m), v (m/s), a (m/s^2), force (N, the motor's).

    Raises:
        UserError: the files cannot be had (see :func:`frictionpinn.data.public.fetch`).
    """
    files = fetch("emps")
    trials = []
    for name, path in files.items():
        file = _loadmat(path)
        force = float(file["gtau"].item()) * file["vir"].ravel()
        signals = {"x": file["qm"].ravel(), "x_ref": file["qg"].ravel(), "force": force}
        trial = Trial(name, file["t"].ravel(), signals, start=0.0)
        trials.append(prepare_trial(trial, cutoff_hz=cutoff_hz, rate_hz=rate_hz, thin_cutoff_hz=thin_cutoff_hz))
    units = {"x": "m", "x_ref": "m", "force": "N", "v": "m/s", "a": "m/s^2"}
    return _recording("emps", trials, units, files)


def load_multiarm_pendulum(
    rate_hz: float = 200.0, cutoff_hz: float = 40.0, raw_cutoff_hz: float = 20.0, from_angle: bool = False
) -> Recording:
    """Load the free-swinging pendulum: trials "id_1" to "id_4", "vad_1", "vad_2" and "raw".

    The id and vad trials follow one another in time without a gap and are one run; "raw" is a later run of low
    amplitude, at the end of which the pendulum sticks.

    Args:
        rate_hz: rate after decimation, Hz; recorded are 1 kHz (id, vad; smoothed by the authors) and 10 kHz (raw).
        cutoff_hz: zero-phase low-pass of the authors' angular rate before it is differentiated, and of all signals
            before they are thinned, Hz.
        raw_cutoff_hz: the same for the raw angle, which the encoder quantises to 0.157 mrad, Hz.
        from_angle: take the rate from the authors' angle, at that cutoff, and not theirs, which comes 0.7 ms after it:
            a force balance at one instant sees a quarter of the viscous friction.

    Returns:
        Signals theta (rad, from upright: it hangs at pi), omega (rad/s), alpha (rad/s^2).

    Raises:
        UserError: the files cannot be had (see :func:`frictionpinn.data.public.fetch`); a cutoff that is no number or
            takes the swings away.
    """
    for name, value in (("cutoff_hz", cutoff_hz), ("raw_cutoff_hz", raw_cutoff_hz)):
        if not (isinstance(value, int | float) and value >= LEAST_CUTOFF_HZ):
            raise UserError("impossible low-pass", where=f"multiarm_pendulum {name}", received=repr(value),
                            allowed=f"a number of Hz from {LEAST_CUTOFF_HZ:g}, below half the rate")  # fmt: skip
    files = fetch("multiarm_pendulum", ["estimation", "raw"])
    smoothed = _loadmat(files["estimation"])
    names = [(f"{kind}_{k + 1}", kind, k) for kind in ("id", "vad") for k in range(len(smoothed[f"Time_{kind}"]))]
    times = [smoothed[f"Time_{kind}"][k, 0].ravel() for _, kind, k in names]
    states = np.concatenate([smoothed[f"Y_{kind}"][k, 0] for _, kind, k in names], axis=1)
    # Filtered as the one run that it is, so that no trial has the edges of a filter within the run.
    t, cutoff = np.concatenate(times), raw_cutoff_hz if from_angle else cutoff_hz
    if from_angle:
        _, omega, alpha = differentiate(t, states[0], cutoff)
    else:
        omega, alpha, _ = differentiate(t, states[1], cutoff)
    derived = ("omega", "alpha") if from_angle else ("alpha",)
    whole = Trial("run", t, {"theta": states[0], "omega": omega, "alpha": alpha}, start=0.0, derived=derived)
    run = _inside(thin(whole, rate_hz, cutoff), cutoff)
    trials = []
    for (name, _, _), own in zip(names, times, strict=True):
        first, end = np.searchsorted(run.t, own[0]), np.searchsorted(run.t, own[-1], side="right")
        trials.append(run.part(slice(first, end), name))
    trials.append(_raw_pendulum(files["raw"], rate_hz, raw_cutoff_hz))
    return _recording("multiarm_pendulum", trials, {"theta": "rad", "omega": "rad/s", "alpha": "rad/s^2"}, files)


def _raw_pendulum(path: Path, rate_hz: float, cutoff_hz: float) -> Trial:
    angle = _loadmat(path)["Theta1"][0, 0]
    t, theta = angle["time"].ravel(), angle["signals"][0, 0]["values"].ravel().astype(float)
    trial = Trial("raw", t, {"theta": theta}, start=float(t[0]))  # later than the run by its clock
    made = prepare_trial(trial, position="theta", derivatives=("omega", "alpha"), cutoff_hz=cutoff_hz,
                         rate_hz=rate_hz, thin_cutoff_hz=cutoff_hz, edge_s=0.0)  # fmt: skip
    return _inside(made, cutoff_hz)


def _inside(trial: Trial, cutoff_hz: float) -> Trial:
    """A trial that was low-passed, without the ends where that shows."""
    reach = PADDED / cutoff_hz
    first, end = np.searchsorted(trial.t, [trial.t[0] + reach, trial.t[-1] - reach])
    return trial.part(slice(first, end), trial.name)


def load_brfd(dataset: int = 3, cutoff_hz: float = 50.0, rate_hz: float = 128.0) -> Recording:
    """Load the sine runs of the banded rotary friction damper; the displacement is imposed, the force measured.

    Args:
        dataset: 3 (band tension 30 lb, the one of :data:`FIT` and :data:`HELD_OUT`) or 2 (36 lb).
        cutoff_hz: zero-phase low-pass of all signals, Hz.
        rate_hz: rate after decimation, Hz; recorded are 1024 Hz.

    Returns:
        Trials such as "0.25Hz_30lb_0.5in"; signals x (m), v (m/s), a (m/s^2), force (N, the friction force).

    Raises:
        UserError: no such data set, or the files cannot be had (see :func:`frictionpinn.data.public.fetch`).
    """
    if dataset not in BRFD_TENSION_LB:
        raise UserError("unknown data set", where="brfd dataset", received=repr(dataset), allowed="2, 3")
    prefix = f"dataset{dataset}_"
    files = fetch("brfd", [name for name in DATASETS["brfd"].files if name.startswith(prefix)])
    trials = []
    for name, path in files.items():
        rows = dict(zip(BRFD_COLUMNS, read_brfd(path).T, strict=True))
        signals = {
            "x": to_si(rows["displacement_in"], "in", "m", "displacement_in"),
            "force": to_si(rows["force_kip"], "kip", "N", "force_kip"),
        }
        # The public times carry seven digits, too few to difference at the end of a run.
        t = np.linspace(rows["time_s"][0], rows["time_s"][-1], len(rows["time_s"]))
        trial = Trial(name.removeprefix(prefix), t, signals, start=0.0)
        trials.append(prepare_trial(trial, cutoff_hz=None, rate_hz=rate_hz, thin_cutoff_hz=cutoff_hz))
    return _recording("brfd", trials, {"x": "m", "force": "N", "v": "m/s", "a": "m/s^2"}, files)


def load_ur10e(trials: Sequence[str] | None = None, cut: Sequence[str] = ("loaded",)) -> Recording:
    """Load recordings of the six-joint arm UR10e: about 94 Hz, torques from motor currents.

    Args:
        trials: names of those wanted: 50sec, 30sec, 40sec (periodic motions of these lengths), ptp (from point to
            point), unloaded, loaded (one motion, without and with 2.805 kg at the flange). None: all.
        cut: of them, those that become two halves, ``loaded[0]`` and ``loaded[1]``.

    Returns:
        Signals q_1 to q_6 (rad), v_1 to v_6 (rad/s), tau_1 to tau_6 (N m, the motors' at the joints).

    Raises:
        UserError: an unknown trial, or the files cannot be had (see :func:`frictionpinn.data.public.fetch`).
    """
    trials = list(UR10E_ROWS if trials is None else trials)
    for name in trials:
        choose(name, UR10E_ROWS, "data.options.trials")
    files = fetch("ur10e", trials)
    made: list[Trial] = []
    for name, path in files.items():
        first, last = UR10E_ROWS[name]
        rows = np.loadtxt(path, delimiter=",")[first - 1 : last]
        signals = {f"{kind}_{k + 1}": rows[:, 1 + 6 * block + k] for block, kind in enumerate("qv") for k in range(6)}
        signals |= {f"tau_{k + 1}": gain * rows[:, 13 + k] for k, gain in enumerate(UR10E_GAINS)}
        trial = Trial(name, rows[:, 0] - rows[0, 0], signals, start=0.0)
        half = len(trial) // 2
        halves = [trial.part(slice(0, half), f"{name}[0]"), trial.part(slice(half, None), f"{name}[1]")]
        made += halves if name in cut else [trial]
    units = {name: unit for kind, unit in (("q", "rad"), ("v", "rad/s"), ("tau", "N*m"))
             for name in (f"{kind}_{k + 1}" for k in range(6))}  # fmt: skip
    return _recording("ur10e", made, units, files)


LOADERS: dict[str, Callable[..., Recording]] = {
    "emps": load_emps,
    "multiarm_pendulum": load_multiarm_pendulum,
    "brfd": load_brfd,
    "ur10e": load_ur10e,
}


def load_public(name: str, **options: Any) -> Recording:
    """Load the public set ``name`` with its loader's options; :class:`UserError` for an unknown name."""
    return choose(name, LOADERS, "dataset")(**options)


def _loadmat(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    return loadmat(path)


def _recording(name: str, trials: list[Trial], units: dict[str, str], files: Mapping[str, Path]) -> Recording:
    """Assemble the recording; its checksum covers the published checksums of the files, which fetching verified."""
    published = "".join(DATASETS[name].files[key].sha256 for key in files)
    checksum = hashlib.sha256(published.encode()).hexdigest()
    return Recording(tuple(trials), units, f"{name}: {DATASETS[name].source}", checksum)
