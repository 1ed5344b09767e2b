"""What is known of a contact that slips before any recording of it: friction at rest, and the damping of its bristles.

Few samples tell static friction and Stribeck velocity, and where one of them is at an end of its range the other shows
no more: every estimate of the two is begun in these ranges and held to them weakly.
"""

DAMPING_RATIO = (0.03, 1.0)  # of a bristle with the mass that it stops
STATIC_RATIO = (1.05, 4.0)  # mu_s / mu_c
EXCESS = 0.5  # (mu_s - mu_c) / mu_c: dry contacts have 0.1 to 2
STRIBECK = 0.02  # v_s over the slip velocity (root mean square)
SPREADS = {"mu_s": 1.0, "v_s": 1.5}  # standard deviations of the logarithm: 95 % within factors of 7 and 19
