"""FIGAROH on motions of an arm; run by benchmarks/robot_tools.py in an environment that has figaroh.

    python robot_tools_figaroh.py FOLDER    robot.urdf, motions.npz and task.json stand there; writes predicted.npz

Its own workflow, as its examples for the UR10 have it: a subclass with the trajectory, a configuration, ``initialize``
and ``solve``: base parameters by weighted least squares (``wls``), decimation as parallel filter, Coulomb and viscous
friction, motor inertia and offset of each joint. Between the marks stands what a user writes.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

if len(sys.argv) < 2:
    print("run by benchmarks/robot_tools.py")
    sys.exit()
folder = Path(sys.argv[1])
task = json.loads((folder / "task.json").read_text())
motions = np.load(folder / "motions.npz")

# what a user writes: begin
import yaml  # noqa: E402
from figaroh.data.trajectory import TrajectoryData  # noqa: E402
from figaroh.identification import BaseIdentification  # noqa: E402
from figaroh.tools.load_robot import load_robot  # noqa: E402

CONFIG = {
    "robot": {"name": "ur10e", "properties": {"joints": {"active_joints": task["joints"]}}},
    "tasks": {
        "identification": {
            "problem": {
                "model_components": {"friction": True, "actuator_inertia": True, "joint_offset": True},
                "qr_relative_tolerance": 1e-4,
            },
            "signal_processing": {"sampling_frequency": task["rate"], "cutoff_frequency": task["cutoff_hz"]},
        }
    },
}


class Identification(BaseIdentification):
    def load_trajectory_data(self, data_source=None):
        names = [data_source] if data_source else task["fitted"]
        edge = int(task["edge_s"] * task["rate"])
        parts = [(motions[f"{n}_q"], motions[f"{n}_tau"]) for n in names]
        valid = [np.r_[np.zeros(edge, bool), np.ones(len(q) - 2 * edge, bool), np.zeros(edge, bool)] for q, _ in parts]
        q, tau = (np.concatenate(x) for x in zip(*parts, strict=True))
        return TrajectoryData(
            t=np.arange(len(q)) / task["rate"], joint_names=task["joints"], q=q, effort=tau, mask=np.concatenate(valid),
            effort_kind="joint_torque", effort_unit="N·m",
        )  # fmt: skip


def fit():
    (folder / "figaroh.yaml").write_text(yaml.safe_dump(CONFIG))
    robot = load_robot(str(folder / "robot.urdf"))
    identification = Identification(robot, str(folder / "figaroh.yaml"))
    joints = [robot.model.joints[robot.model.getJointId(name)] for name in task["joints"]]
    identification.identif_config["act_idxq"] = [joint.idx_q for joint in joints]
    identification.identif_config["act_idxv"] = [joint.idx_v for joint in joints]
    identification.initialize()
    identification.solve(decimate=True, decimation_factor=task["thinned"], wls=True, plotting=False)
    return identification


# what a user writes: end


began = time.process_time()
identification = fit()
seconds = time.process_time() - began
predicted = {}
for name in task["predicted"]:
    identification._load_validation_data(name)
    series = identification._compute_validation_metrics()["tau_identified_per_joint"]
    predicted[name] = np.stack([series[joint] for joint in task["joints"]], axis=1)
np.savez(folder / "predicted.npz", seconds=seconds, parameters=len(identification.phi_base), **predicted)
