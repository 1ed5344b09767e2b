/* Friction compensation of an axis: $title.
 * Written by frictionpinn $version. C99, needs libm alone, allocates nothing, all memory in the struct: $bytes doubles.
 * One call in every cycle of $interval s. Units: position $slip, torque $force, time s. */
#ifndef COMPENSATOR_H
#define COMPENSATOR_H

enum {
    COMPENSATOR_STATES = $n_s,
    COMPENSATOR_UNKNOWNS = $n_w,
    COMPENSATOR_PARAMETERS = $n_p,
    COMPENSATOR_ADAPTED = $k,
    COMPENSATOR_FILTER = $n,
    COMPENSATOR_PAST = $past,
    COMPENSATOR_ROW = $row
};

typedef struct {
    double torque, low, high; /* to add to the controller's torque, and its 95 % interval */
} compensator_command;

typedef struct {
    double x[COMPENSATOR_FILTER], covariance[COMPENSATOR_FILTER][COMPENSATOR_FILTER];
    double s[COMPENSATOR_STATES], w[COMPENSATOR_UNKNOWNS], z[COMPENSATOR_STATES][COMPENSATOR_ADAPTED + 1];
    double p[COMPENSATOR_PARAMETERS]; /* in force, in the order of compensator_names */
    double past[COMPENSATOR_PAST][COMPENSATOR_ROW];
    double time, feedback, wanted, scale, last;
    long begun;
} compensator;

extern const char *const compensator_names[COMPENSATOR_PARAMETERS];

/* Before the first cycle, or to begin anew. */
void compensator_reset(compensator *c);

/* One cycle.
 * reference: position, velocity and acceleration wanted when the torque will act, $delay s and half a cycle from now;
 * position: measured now, NAN where there is no reading; torque: commanded in the cycle before, limits and
 * compensation included. Where reference or torque is no finite number nothing is added and nothing learned. */
compensator_command compensator_update(compensator *c, const double reference[3], double position, double torque);

#endif
