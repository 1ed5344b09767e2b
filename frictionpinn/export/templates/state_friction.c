#include "friction.h"

#include <float.h>
#include <math.h>

#define VELOCITIES $velocities
#define LOADS $loads
#define ROWS (FRICTION_STATES + 1)

/* v0, first and step of asinh(v / v0), first load and step */
static const double grid[5] = $grid;
/* T of every bristle, then r, over velocities and loads */
static const double table[ROWS * VELOCITIES * LOADS] = $tables;
/* stiffness, damping, gap, sharpness of every bristle */
static const double element[4 * FRICTION_STATES] = $elements;

static double held(double position, double last) {
    return !(position > 0.0) ? 0.0 : position > last ? last : position;  /* 0 where it is no number, too */
}

static void look(double v, double N, double seen[ROWS]) {
    double x = held((asinh(v / grid[0]) - grid[1]) / grid[2], VELOCITIES - 1.0);
    double y = held((N - grid[3]) / grid[4], LOADS - 1.0);
    int i = (int)x, j = (int)y, k;
    if (i > VELOCITIES - 2) i = VELOCITIES - 2;
    if (j > LOADS - 2) j = LOADS - 2;
    x -= i;
    y -= j;
    for (k = 0; k < ROWS; k++) {
        const double *row = table + (k * VELOCITIES + i) * LOADS + j;
        const double low = (1.0 - y) * row[0] + y * row[1], high = (1.0 - y) * row[LOADS] + y * row[LOADS + 1];
        seen[k] = low + x * (high - low);
    }
}

double friction_rates(double v_slip, double N, const double z[FRICTION_STATES], double rate[FRICTION_STATES]) {
    double seen[ROWS], force;
    int k;
    look(v_slip, N, seen);
    force = v_slip * seen[FRICTION_STATES];
    for (k = 0; k < FRICTION_STATES; k++) {
        const double *e = element + k;
        const double gap = e[2 * FRICTION_STATES], size = fabs(z[k]), side = z[k] < 0.0 ? -1.0 : 1.0;
        const double s = gap + N * seen[k], b = size > 0.0 ? pow(size / s, e[3 * FRICTION_STATES]) : 0.0;
        const double spring = e[0] * (size > gap ? size - gap : 0.0);
        double damping;
        rate[k] = 0.0;
        if (s <= 0.0) continue;  /* without a load it carries nothing */
        rate[k] = v_slip - fabs(v_slip) * side * b;
        damping = e[FRICTION_STATES] * rate[k];
        if (rate[k] * v_slip < 0.0 && fabs(damping) > spring * b) damping = -side * spring * b;
        force += side * spring + damping;
    }
    return force;
}

double friction_step(double z[FRICTION_STATES], double v_slip, double N, double dt) {
    double seen[ROWS], rate[FRICTION_STATES];
    int k;
    look(v_slip, N, seen);
    /* of a sample that is no number the force is none either, and the bristles stay as they are */
    for (k = 0; k < FRICTION_STATES && fabs(v_slip) <= DBL_MAX && N <= DBL_MAX; k++) {
        const double s = element[2 * FRICTION_STATES + k] + N * seen[k], n = element[3 * FRICTION_STATES + k];
        if (s <= 0.0) {
            z[k] = 0.0;
            continue;
        }
        const double bent = fabs(z[k]) > 0.0 ? pow(fabs(z[k]) / s, n - 1.0) : n == 1.0 ? 1.0 : 0.0;
        const double X = fabs(v_slip) * dt / s * bent;
        const double after = z[k] * exp(-X) + v_slip * dt * (X > 1e-4 ? -expm1(-X) / X : 1.0 - X / 2.0);
        const double end = v_slip > 0.0 ? s : v_slip < 0.0 ? -s : 0.0;  /* where it settles */
        z[k] = n != 1.0 && (after - end) * (z[k] - end) < 0.0 ? end : after;
    }
    return friction_rates(v_slip, N, z, rate);
}
