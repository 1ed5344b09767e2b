"""The pendulum on a box in MuJoCo, its swing tracked by computed torque.

python simulate_pob.py [law|network] > run.csv
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
from friction_mujoco import Friction, Reaction

HERE = Path(__file__).resolve().parent
AMPLITUDE, FREQUENCY, DURATION = np.deg2rad(45), 1.0, 2.0  # rad, Hz, s


def swing(t: float) -> tuple[float, float, float]:
    """Angle of the link from upright, its rate and acceleration."""
    w = 2 * np.pi * FREQUENCY
    return AMPLITUDE * np.sin(w * t), AMPLITUDE * w * np.cos(w * t), -AMPLITUDE * w**2 * np.sin(w * t)


def main(kind: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(HERE / "pob.xml"))
    data = mujoco.MjData(model)
    friction = Friction(model, kind, joint="x", normal=Reaction("box"))
    x, theta = data.joint("x"), data.joint("theta")
    theta.qpos[0], theta.qvel[0], _ = swing(0.0)
    print("t,x,v,theta,normal_force,friction_force,torque")
    while data.time < DURATION - model.opt.timestep / 2:
        angle, rate, acceleration = swing(data.time)
        acceleration += 100.0 * (rate - theta.qvel[0]) + 2500.0 * (angle - theta.qpos[0])
        force = friction.step(data, accelerations={"theta": acceleration})
        values = (data.time, x.qpos[0], x.qvel[0], theta.qpos[0], friction.normal, force, friction.torque["theta"])
        print(",".join(f"{value:.9g}" for value in values))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "$kind")
