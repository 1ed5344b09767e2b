"""Every threshold of the check before any fit, and of how logs are mended, with its reason.

None is made for a recording, none changes with the sampling rate or with the number of samples: they are shares,
factors, standard errors and times. What counts samples does so because slips come by the row, or bounds computing.
"""

# Clocks (:mod:`frictionpinn.data.clock`, ``prepare``)
JITTER = 0.05  # of a step: recorders' clocks jitter and times are rounded when written; filters need an even rate
BEHIND = 10.0  # steps by which a row may come too late: loggers buffer a few rows; further back time begins anew
FEW = 0.1  # of the rows that repeat a time: more show a clock that is too coarse, not a logger's slip
BRIDGED = 0.01  # of a signal's amplitude: by so much a straight line over a gap may err, the usual noise of a sensor
STEPS = 3.0  # steps: two rows in a row are lost in a gap; one, or steps that double, are how a log was sampled
MIN_SAMPLES = 10  # of a trial, and of a part between two gaps: a law's parameters and an initial state need as many
TURN_SPREAD = 3.0  # times the usual change between two samples: by so much a jump by a turn may differ from a turn
TURN_ROUNDED = 1e-3  # rad: a turn in degrees that was written with one digit
USUAL = 0.99  # quantile that stands for the largest: one sample in a hundred may be an outlier

# Values
LARGEST = 1e50  # of a recorded value, SI units: its powers still are numbers

# What is looked at: seconds of computing; more samples of the same recording tell the same
MOST_SAMPLES = 60_000  # of a recording
LOOKED_AT = 20_000  # of a trial, by which it is told how fast signals change
FEWEST = 8  # samples of a window: below, the derivative of a bump is no longer smooth
WINDOWS = 6  # of a trial's length at least: fewer are no statistics
WELL_KNOWN = 10.0  # independent windows: two for each of a balance's five unknowns

# Statistics
CLEAR = 0.9  # share of a filtered signal's variance that is no noise: relations of such signals err by a few per cent
HALF = 0.5  # less of a variance explained, or of what was left: most of it is something else
SURE = 5.0  # standard errors: by chance once in two million looks, and a recording is looked at some dozen times
# Noise in a velocity's variance, 1 % of its size: dry friction's steps are then where they seem to be, and the motion
# can be taken as measured.
AS_MEASURED = 1e-4

# Single channels
HELD = 0.02  # share of the time at a signal's very end by which it counts as clipped: a peak stays there a few samples
# Share of the range within which samples lie near an end, and how many times as many as these stay at it where it was
# clipped: a smooth peak's top 2 % holds many samples beside the few that are equal.
NEAR_END, PILED = 0.02, 3
# Share of a trial at whose end a signal holds one value by which its sensor counts as dead, and share of the samples
# before that may repeat the last one: noise, written with some digits, repeats by chance.
DEAD, REPEATED = 0.1, 0.1
LEVELS = 32  # levels between a signal's ends: 5 bits, rounding by 1 % of the range
TURNS = 4.0  # turns of an angle beyond which degrees are likelier than a wheel
ONE_WAY = 0.02  # share of the time by which a contact must slip the other way, too, for friction to be told apart
AT_REST = 0.1  # of a signal's root mean square: what moves less stands still

# Derivatives, and forces against motion
OFF = 1.25  # a sensor is calibrated better; what is less off is for the diagnosis (sensor_scale)
ANOTHER = 2.0  # times the declared inertia: an undeclared payload is less, this is another mechanism or unit
EXPLAINED = 0.8  # of the driving force: friction that is neither dry nor viscous, and noise, leave up to a fifth
INERTIAL = 0.1  # of the force's variance: a damper's force that goes with the acceleration by more moves a mass
NAMED = 0.05  # how closely a factor is that of a unit: units differ by far more, sensors by less
# Of the time in which a signal changes by its size (3 % of it is wrong at any instant): a delay that matters.
LATE = 0.03
SEARCHED = 0.1  # of the recording by which a signal is moved to find a delay: a longer one is another recording
