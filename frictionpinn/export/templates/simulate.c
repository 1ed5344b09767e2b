/* Simulates: $title, with the exported friction in its equation of motion.
 *
 *   cc -std=c99 -O2 -DFRICTION_STRIDE=$stride -o simulate simulate.c friction.c -lm
 *   ./simulate $which < swing.csv > motion.csv
 *
 * Every line of the input holds, at steps of FRICTION_INTERVAL / FRICTION_STRIDE seconds from time 0:
 *   $inputs
 * Every line of the output: t, $state, normal_force, friction_force. It starts at rest at 0. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "friction.h"

#ifndef FRICTION_STRIDE
#define FRICTION_STRIDE 1
#endif
#define M $m  /* coordinates that move freely */
#define U $u  /* inputs */

/* Slip velocity, normal force and frictionless slip acceleration, from positions and velocities y and inputs u. */
static void contact(const double *y, const double *u, double *out)
{
$contact
}

/* Accelerations of the free coordinates and of slip under the friction force F. */
static void motion(double F, const double *y, const double *u, double *out)
{
$motion
}

typedef struct {
    double y[2 * M], slip, normal, frictionless, slip_acceleration;
} state;

typedef struct {
    double h, u[U], ahead[U]; /* inputs now and at the next step */
    long k;
    state before, earlier; /* one and two steps ago */
    state next;            /* contact where the start would be with the next inputs */
$members
} simulation;

/* The state in which this step ends under the force F: second-order backward differences, the first step Euler's. */
static state end(const simulation *s, double F)
{
    state now = s->before;
    double out[M + 3];
    int i, round;
    for (round = 0; round < 3; round++) {
        motion(F, now.y, s->u, out);
        for (i = 0; i < M && s->k > 0; i++) {
            const int second = s->k > 1;
            const double old_v = second ? (4.0 * s->before.y[M + i] - s->earlier.y[M + i]) / 3.0 : s->before.y[M + i];
            const double old_q = second ? (4.0 * s->before.y[i] - s->earlier.y[i]) / 3.0 : s->before.y[i];
            const double h = second ? 2.0 / 3.0 * s->h : s->h;
            now.y[M + i] = old_v + h * out[i];
            now.y[i] = old_q + h * now.y[M + i];
        }
    }
    motion(F, now.y, s->u, out);
    now.slip_acceleration = out[M];
    contact(now.y, s->u, out);
    now.slip = out[0];
    now.normal = out[1];
    now.frictionless = out[2];
    return now;
}

$friction

/* The F with F = friction(F), by the secant method within a bracket. */
static double solve(simulation *s, double guess)
{
    double low = guess, high = guess, step = 1e-3 * $scale, f_low, f_high, middle, f;
    int i;
    f_low = f_high = guess - friction(s, guess, 0);
    for (i = 0; i < 60 && f_low > 0.0; i++, step *= 2.0) {
        low -= step;
        f_low = low - friction(s, low, 0);
    }
    for (i = 0, step = 1e-3 * $scale; i < 60 && f_high < 0.0; i++, step *= 2.0) {
        high += step;
        f_high = high - friction(s, high, 0);
    }
    for (i = 0; i < 100 && high - low > 1e-9 * $scale; i++) {
        middle = i % 3 == 2 || f_high == f_low ? (low + high) / 2.0 : low - f_low * (high - low) / (f_high - f_low);
        f = middle - friction(s, middle, 0);
        if (f == 0.0)
            return middle;
        if (f < 0.0) {
            low = middle;
            f_low = f;
        } else {
            high = middle;
            f_high = f;
        }
    }
    return (low + high) / 2.0;
}

/* Reads the inputs of a line: 1, or 0 at the end of the input; a line that does not hold U finite numbers ends it all. */
static int line(double *u)
{
    static long count;
    int i, got;
    for (count++, i = 0; i < U; i++) {
        got = scanf(i ? ",%lf" : " %lf", &u[i]);
        if (got == EOF && i == 0)
            return 0;
        if (got != 1 || !(u[i] - u[i] == 0.0)) {
            fprintf(stderr, "line %ld of the input does not hold %d finite numbers with commas between\n", count, U);
            exit(2);
        }
    }
    return 1;
}

int main(int argc, char **argv)
{
    static simulation s;
    double F = 0.0;
    int i, more;
    memset(&s, 0, sizeof s);
    s.h = FRICTION_INTERVAL / FRICTION_STRIDE;
$choose
    if (!line(s.ahead))
        return 0;
    for (more = 1; more; s.k++) {
        memcpy(s.u, s.ahead, sizeof s.u);
        more = line(s.ahead);
        if (s.k == 0) {
            simulation peek = s;
            memcpy(peek.u, s.ahead, sizeof s.u);
            s.next = end(&peek, 0.0);
            s.before = s.earlier = end(&s, 0.0);
        }
        F = solve(&s, F);
        (void)friction(&s, F, 1);
        printf("%.9g", s.k * s.h);
        for (i = 0; i < 2 * M; i++)
            printf(",%.12g", s.before.y[i]);
        printf(",%.9g,%.9g\n", s.before.normal, F);
        if (!(s.before.normal > 0.0)) {
            fprintf(stderr, "contact lost at t = %g s\n", s.k * s.h);
            return 1;
        }
    }
    return 0;
}
