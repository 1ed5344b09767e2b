"""The EMPS drive by maximum likelihood: mass, viscous, Coulomb and constant force beside the published values.

    FRICTIONPINN_DATA=... python benchmarks/identify_emps.py

Fit on DATA_EMPS in windows of 1 s with free initial states (the loop was closed). Writes
benchmarks/results/identify_emps.txt.
"""

from pathlib import Path

from frictionpinn.data.sets import load_emps
from frictionpinn.identify import maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

# Janot, Gautier and Brunot (2019): regression of the force on filtered and differentiated position.
PUBLISHED = {"M": 95.11, "sigma_2": 203.5, "mu_c": 20.39, "constant_force": -3.16}


def main() -> None:
    mechanism = Mechanism(SYSTEMS["drive"](), LAWS["coulomb_viscous"](), ("constant_force",))
    estimate = maximum_likelihood(mechanism, load_emps().select(["fit"]), free=tuple(PUBLISHED), windows=1.0)
    lines = [f"EMPS, fit file: {estimate.outcome}, {estimate.n_simulations} simulations, {estimate.seconds:.1f} s"]
    lines.append(f"{'parameter':<16}{'value':>10}  {'95 % interval':<22}{'published':>10}  unit")
    for name, known in PUBLISHED.items():
        low, high = estimate.ci95[name]
        inside = "" if low <= known <= high else "  (outside)"
        span = f"[{low:.5g}, {high:.5g}]"
        lines.append(
            f"{name:<16}{estimate.values[name]:>10.5g}  {span:<22}{known:>10.5g}  {estimate.units[name]}{inside}"
        )
    lines += ["the preload is 1 N, so mu_c reads as the Coulomb force in N", *estimate.advice]
    text = "\n".join(lines) + "\n"
    print(text)
    (Path(__file__).resolve().parent / "results" / "identify_emps.txt").write_text(text)


if __name__ == "__main__":
    main()
