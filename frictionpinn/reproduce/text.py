"""What the document says beside its figures: no measured number stands here."""

HEAD = """# The paper, reproduced

Every table and figure of *Learning Transferable Friction Models and LuGre Identification via Physics-Informed Neural
Networks* (Ozmen, Hespanha and Byl, arXiv 2504.12441), ours beside theirs. This page is written by `make paper` from the
result files in `docs/paper/`; no number in it is typed by hand.
"""

MADE = """Setting: {settings} (`conf/setting/`); the last sessions of its parts took {minutes} min in all.
`python reproduce.py setting=full` runs all seeds and steps. Every part writes its result file once: an interrupted
reproduction goes on where it stopped, what was finished before is not counted again, and
`python reproduce.py parts=[transfer] again=true` runs one part again.
"""

FIDELITY = """Friction learned from noisy motion through the equation of motion, scored against the true friction
force of the simulated pendulum on a box. *Online*: the noisy signals of each instant, filtered causally, into the
network. *In simulation*: the network inside the equation of motion, without noise, the motion its own.

What differs from the paper: its trajectories are not published, ours follow its description (Traj. 1 a constant
oscillation, Traj. 2 a skewed swing with long rests that carries the box in +x). Its equations are not those that
Lagrange's method gives; ours are derived (their cost is measured below). Our networks are narrower and smooth, odd
in the motion, and train on consistently smoothed signals; BB2 and PE2 see a short causal window of the past. PE1
and BB1 see one instant, as published: at rest velocity and normal force say nothing of the friction force, which is
what their online error on Traj. 2 shows.
"""

IN_MOTION = """A network trained on noisy samples blurs the step of the friction force at rest over the velocities
that the noise may hide. Online that is the best estimate; in the equation of motion it creeps. So BB1 and PE1 are
fitted further, on the training trials alone (`rollout=true`), for simulation alone. PE1: its bristle is a state that
settles to what the network says of sliding; stiffness, damping, the peak and its velocity, and a gain of the network
are those with which the simulated training trials meet their noisy accelerations and velocities. BB1, without memory:
its last layer is solved again for the force per load of the samples that surely slide; the width of the step at
rest, and its gains at rest and at speed, are fitted in the same simulations. The rows *without the fit in motion* are
the networks as trained. BB2 and PE2 look at windows of the past and are simulated as trained: at rest they enter limit
cycles, and a simulation fails where no force satisfies the equation of motion.
"""

MEMORY = """The same networks with a state instead of windows of the past: bristles in parallel that dissipate by
construction (`model.memory=state`, docs/guide/memory.md). *Through the balance* their force is compared with that of
the equation of motion; *through the motion* (`experiment=memory`) segments of the trials are simulated and velocity
and force compared with the measured ones, which wants the frictionless acceleration that BB2 and PE2 see. BB1 and PE1
with windows are fitted in motion, as above.
"""

VARIANTS = {
    "windows": "windows",
    "balance": "state, through the balance",
    "motion": "state, through the motion",
}

CHARACTERISTICS = """Steady friction force over slip velocity and normal force, within what the training trials
cover: PE1, BB1, and LuGre in steady sliding.
"""

EQUATIONS = """The published equation of the swing has J_L + m_L d instead of J_L + m_L d², and its normal force
drops theta'' sin theta. Where the swing is prescribed only the normal force matters. *lagrange*: data and model
obey the derived equations. *published, data obey lagrange*: the model believes the published ones about a mechanism
that does not. *published throughout*: simulated and learned with the published equations, as in the paper.
A parameter without a standard error lies at a bound: the slow moments that tell static friction are few.
"""

TRANSFER = """Each model trained on one system and put, as it is, into the other: only normal force, slip velocity
and (BB2, PE2) frictionless acceleration cross over. The spring-damper's values are not published; ours are in
`conf/system/sdob.yaml`. On the pendulum on a box the error is the mean over Traj. 1 and Traj. 2, on the
spring-damper that of its held-out trial. The other systems of the project (drive, pendulum, damper) have contacts
with other forces and units, so carrying a model there would say nothing.
"""

IDENTIFICATION = """The same noisy training trials, bounds, starts and compiled simulator for every estimator. Times
are of the processor, so that they do not depend on what else the machine does; equations are compiled beforehand.
The force error is that of the held-out trial, simulated with the estimate.
"""

PROTOCOLS = {
    "near": "Bounds of ±20 % around the truth, sigma_1 = sqrt(sigma_0), as the published values suggest",
    "decade": "Bounds a decade wide with the truth anywhere in their middle 70 %, sigma_1 free",
}

IDENTIFICATION_NOTES = """What the bounds do: with the published ones any value within them is close to the truth,
so the table says little about the estimators. Over a decade they have to find it. Static friction is searched as
what it exceeds Coulomb friction by, so its bounds hold for that difference. The least-squares sigma_1 as published
belongs to a sigma_0 a hundred times smaller than the printed one.
"""

ABLATION = """One choice changed at a time, everything else at its default: the presets
`conf/experiment/ablation_*.yaml`, which `python train.py -m experiment=ablation_noise` (inputs, window, lambda,
noise, trials, rate, activation, smoothing, rollout) runs by itself. Rollout, the fit in motion, is for simulation
alone: its runs are evaluated there, and the figure shows that.
"""
