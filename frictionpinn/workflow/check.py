"""What a recording is and what speaks against it, without any fit."""

from __future__ import annotations

from ..data.findings import Finding
from ..data.split import split_trials
from ..errors import UserError
from .build import Config, build_noise, build_recording, build_system, check_pairing, seed_of
from .configs import called
from .vet import assumptions, findings_of, in_words, measured_well


def check(cfg: Config) -> list[Finding]:
    """Print trials, assumptions and findings of the recording of ``cfg``.

    Args:
        cfg: resolved conf/check.yaml.

    Raises:
        UserError: the recording cannot be read, or a finding is grave.
    """
    if cfg["system"]["name"] == "robot":
        from . import robot

        return robot.check(cfg)
    if cfg["smoothing"]["name"] != "none":
        raise UserError("the check does not smooth: it looks at the recording as it is", where="smoothing",
                        received=cfg["smoothing"]["name"], allowed="none", fix="leave smoothing= out")  # fmt: skip
    check_pairing(cfg)
    system = build_system(cfg["system"])
    recording = build_noise(cfg["noise"])(build_recording(cfg["data"], system), seed_of(cfg))
    if "held_out" in (data := cfg["data"]):  # what a fit of this recording would refuse
        split_trials(recording.names, data["held_out"], data.get("validation"), data.get("training_trials"))
    lengths = [float(trial.t[-1] - trial.t[0]) for trial in recording.trials]
    count = len(recording.trials)
    rate = (len(recording) - count) / max(sum(lengths), 1e-300)
    told = f"{len(recording)} samples in {count} trial{'s' if count > 1 else ''}, {sum(lengths):.4g} s, {rate:.4g} Hz"
    print(f"{recording.source}: {told}", flush=True)
    free = cfg.get("free") or ()
    for line in assumptions(system, recording, free):
        print(line)
    findings = findings_of(system, recording, free)
    for finding in findings:
        print(in_words(finding))
    if grave := [f for f in findings if f.grave]:
        raise UserError(f"{len(grave)} finding{'s' if len(grave) > 1 else ''} by which no answer would have a sense",
                        where=recording.source, fix="mend what is told to be wrong")  # fmt: skip
    if measured_well(system, recording) and not cfg["system"].get("imposed"):
        print("force and motion were measured well: system.imposed=true would take the motion as measured, for closed "
              "loops and long recordings")  # fmt: skip
    print("nothing speaks against this recording" if not findings else "nothing grave speaks against this recording")
    print(f"next: {called('diagnose')} with the same system and data says what a friction model lacks")
    return findings
