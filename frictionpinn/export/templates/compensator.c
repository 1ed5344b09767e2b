#include "compensator.h"

#include <math.h>
#include <string.h>

enum {
    NS = COMPENSATOR_STATES,
    NW = COMPENSATOR_UNKNOWNS,
    NU = $n_u,
    K = COMPENSATOR_ADAPTED,
    N = COMPENSATOR_FILTER,
    CELLS = $cells, /* places along the stroke */
    SURFACE = 2 * CELLS + (CELLS > 0),
    PAST = COMPENSATOR_PAST,
    OUT = NW + NW * (NS + NW) + 1
};
enum { DEVIATION, SPEED, DISTURBANCE, THETA };
enum { EXCESS, POSITION, VELOCITY, ACCELERATION, FRICTION, SLOPES };

const char *const compensator_names[COMPENSATOR_PARAMETERS] = {$names};

static const double first[COMPENSATOR_PARAMETERS] = {$p};
static const double known[COMPENSATOR_PARAMETERS] = {$known};
static const int places[K + 1] = {$places};
static const double walks[K + SURFACE + 1] = {$walks};
static const double spread[K + SURFACE + 2] = {$spread};
static const double h = $h, lag = $lag, inertia = $inertia, noise = $noise, walk = $walk, still = $still,
                    passing = $passing, limit = $limit, gain_of_all = $gain, low = $low, width = $width;

/* R, dR/ds and dR/dw, row by row. */
static void newton(const double *s, const double *w, const double *u, const double *p, double *out)
{
$newton
}

static double friction(const double *s, const double *w, const double *u, const double *p)
{
$friction
}

/* dR/dp of the parameters that adapt, row by row. */
static void strengths(const double *s, const double *w, const double *u, const double *p, double *out)
{
$strengths
}

static void inputs(double *u, double t)
{
    memset(u, 0, NU * sizeof *u);
    (void)t;
$clocks}

static double least(double a, double b) { return b < a ? b : a; }
static double most(double a, double b) { return b > a ? b : a; }

static int factorize(double m[NW][NW], int *pivots)
{
    int i, j, c;
    for (j = 0; j < NW; j++) {
        int best = j;
        for (i = j + 1; i < NW; i++)
            if (fabs(m[i][j]) > fabs(m[best][j]))
                best = i;
        pivots[j] = best;
        if (!(fabs(m[best][j]) > 0.0 && isfinite(m[best][j])))
            return 0;
        if (best != j)
            for (i = 0; i < NW; i++) {
                const double kept = m[j][i];
                m[j][i] = m[best][i];
                m[best][i] = kept;
            }
        for (i = j + 1; i < NW; i++) {
            m[i][j] /= m[j][j];
            for (c = j + 1; c < NW; c++)
                m[i][c] -= m[i][j] * m[j][c];
        }
    }
    return 1;
}

static void back_substitute(double m[NW][NW], const int *pivots, double *b)
{
    int i, j;
    for (j = 0; j < NW; j++) {
        const double kept = b[j];
        b[j] = b[pivots[j]];
        b[pivots[j]] = kept;
        for (i = j + 1; i < NW; i++)
            b[i] -= m[i][j] * b[j];
    }
    for (j = NW - 1; j >= 0; j--) {
        b[j] /= m[j][j];
        for (i = 0; i < j; i++)
            b[i] -= m[i][j] * b[j];
    }
}

/* One implicit Euler step of what remembers, at the q, v and a in s and w. */
static void remember(compensator *c, const double *u, double *out, double m[NW][NW], int *pivots)
{
    double ahead[NS], change[NW];
    int i, j, n;
    memcpy(ahead, c->s, sizeof ahead);
    for (n = 0; n < $iterations; n++) {
        double largest = 0.0, size = 0.0;
        for (i = 2; i < NS; i++)
            ahead[i] = c->s[i] + h * c->w[i - 1];
        newton(ahead, c->w, u, c->p, out);
        for (i = 0; i < NW; i++) {
            change[i] = -out[i];
            m[i][0] = out[NW + NW * NS + i * NW] + h * (out[NW + i * NS + 1] + h * out[NW + i * NS]);
            for (j = 1; j < NW; j++)
                m[i][j] = out[NW + NW * NS + i * NW + j] + h * out[NW + i * NS + 1 + j];
        }
        change[0] = 0.0;
        m[0][0] = 1.0;
        for (i = 1; i < NW; i++)
            m[0][i] = m[i][0] = 0.0;
        if (!factorize(m, pivots))
            break;
        back_substitute(m, pivots, change);
        for (i = 1; i < NW; i++) {
            c->w[i] += change[i];
            largest = most(largest, fabs(change[i]));
            size = most(size, fabs(c->w[i]));
        }
        if (largest <= $settled * size)
            break;
    }
    for (i = 2; i < NS; i++)
        c->s[i] += h * c->w[i - 1];
}

/* dT/dtheta; the derivative of what remembers is carried along. */
static void sensitivities(compensator *c, const double *u, const double *out, double m[NW][NW], const int *pivots)
{
    double theirs[NW * K + 1], row[NW];
    int i, j, d;
    memset(theirs, 0, sizeof theirs);
    strengths(c->s, c->w, u, c->p, theirs);
    for (j = 0; j < K; j++) {
        const double p = c->p[places[j]];
        double slope = theirs[j] * p;
        row[0] = 0.0;
        for (i = 1; i < NW; i++) {
            row[i] = -theirs[i * K + j] * p;
            for (d = 2; d < NS; d++)
                row[i] -= out[NW + i * NS + d] * c->z[d][j];
        }
        back_substitute(m, pivots, row);
        for (d = 2; d < NS; d++) {
            c->z[d][j] += h * row[d - 1];
            slope += out[NW + d] * c->z[d][j] + out[NW + NW * NS + d - 1] * row[d - 1];
        }
        c->past[0][SLOPES + j] = slope;
    }
}

/* Add weight times the derivatives of the torque in d, theta and what depends on the place, of a row of past. */
static void slopes(const double *past, double weight, double *found)
{
    int i;
    found[DISTURBANCE] += weight;
    for (i = 0; i < K; i++)
        found[THETA + i] += weight * past[SLOPES + i];
    if (CELLS) {
        const double x = least(most((past[POSITION] - low) / width, 0.0), CELLS - 1.0);
        const int before = (int)x < CELLS - 2 ? (int)x : CELLS - 2, place = THETA + K + before;
        const double share = x - before;
        found[place] += weight * (1.0 - share);
        found[place + CELLS] += weight * (1.0 - share) * past[FRICTION];
        found[place + 1] += weight * share;
        found[place + 1 + CELLS] += weight * share * past[FRICTION];
        found[N - 1] += weight * fabs(past[FRICTION]);
    }
}

static void predict(compensator *c, double share)
{
    const int whole = (int)lag;
    const double part = lag - whole;
    const double *a = c->past[whole], *b = c->past[whole + 1];
    const double inverse = 1.0 / inertia;
    double rate[N], f[2][N], moved[2][N], acceleration;
    int i, j, k;
    memset(rate, 0, sizeof rate);
    slopes(a, (part - 1.0) * inverse, rate);
    slopes(b, -part * inverse, rate);
    acceleration = inverse * ((1.0 - part) * a[EXCESS] + part * b[EXCESS]);
    for (i = DISTURBANCE; i < N; i++)
        acceleration += rate[i] * c->x[i];
    c->x[DEVIATION] += h * c->x[SPEED] + 0.5 * h * h * acceleration;
    c->x[SPEED] += h * acceleration;
    for (j = 0; j < N; j++) {
        f[0][j] = 0.5 * h * h * rate[j];
        f[1][j] = h * rate[j];
    }
    f[0][0] += 1.0;
    f[0][1] += h;
    f[1][1] += 1.0;
    memset(moved, 0, sizeof moved);
    for (k = 0; k < N; k++)
        if (f[0][k] != 0.0 || f[1][k] != 0.0)
            for (j = 0; j < N; j++) {
                moved[0][j] += f[0][k] * c->covariance[k][j];
                moved[1][j] += f[1][k] * c->covariance[k][j];
            }
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 2; j++) {
            double total = 0.0;
            for (k = 0; k < N; k++)
                total += moved[i][k] * f[j][k];
            c->covariance[i][j] = total;
        }
        for (j = 2; j < N; j++)
            c->covariance[i][j] = c->covariance[j][i] = moved[i][j];
    }
    c->covariance[1][0] = c->covariance[0][1];
    c->covariance[DISTURBANCE][DISTURBANCE] += walk * h * share;
    for (i = 0; i < K + SURFACE; i++)
        c->covariance[THETA + i][THETA + i] += walks[i] * h * share;
}

/* Position and velocity of the reference now, which is that of a cycle some time ago. */
static double asked(const compensator *c, double *velocity)
{
    const int nearest = (int)(lag + 1.0) < PAST - 1 ? (int)(lag + 1.0) : PAST - 1;
    const double since = (nearest - lag - 0.5) * h, *then = c->past[nearest];
    *velocity = then[VELOCITY] + since * then[ACCELERATION];
    return then[POSITION] + since * (then[VELOCITY] + 0.5 * since * then[ACCELERATION]);
}

/* Before the first command acts the axis rests, while its reference may move; how it breaks away is not known. */
static void wait(compensator *c, double reading)
{
    double v;
    const double q = asked(c, &v);
    c->x[SPEED] = -v;
    c->covariance[SPEED][SPEED] = v * v;
    if (isfinite(reading))
        c->x[DEVIATION] = reading - q;
}

static void correct(compensator *c, double reading, double share)
{
    double then;
    const double here = asked(c, &then);
    const double variance = c->covariance[0][0] + noise;
    double gain[N], row[N], shown, error, reach;
    int i, j;
    if (!(isfinite(reading) && variance > 0.0))
        return;
    shown = reading - here - c->x[0];
    reach = $wild * sqrt(variance);
    error = least(most(shown, -reach), reach);
    reach = most(reach, fabs(c->last)); /* a reading alone may be a glitch; what the next one confirms is the axis */
    c->last = shown;
    shown = least(most(shown, -reach), reach);
    c->scale += share * h / $memory * (error * error / variance - c->scale);
    for (i = 0; i < N; i++) {
        row[i] = c->covariance[0][i];
        gain[i] = row[i] / variance * (i < DISTURBANCE ? 1.0 : share);
        if (i >= THETA + K && i < THETA + K + 2 * CELLS)
            gain[i] /= 1.0 + c->past[0][VELOCITY] / passing * (c->past[0][VELOCITY] / passing);
        c->x[i] += gain[i] * (i < THETA ? shown : error);
    }
    c->x[DISTURBANCE] = least(most(c->x[DISTURBANCE], -limit), limit);
    for (i = THETA; i < N; i++) {
        const double furthest = i < THETA + K ? $furthest : i < THETA + K + CELLS ? limit : 1.0;
        c->x[i] = least(most(c->x[i], -furthest), furthest);
    }
    for (i = 0; i < N; i++)
        for (j = 0; j <= i; j++) {
            c->covariance[i][j] += gain[i] * gain[j] * variance - gain[i] * row[j] - row[i] * gain[j];
            c->covariance[j][i] = c->covariance[i][j];
        }
}

void compensator_reset(compensator *c)
{
    memset(c, 0, sizeof *c);
}

static void begin(compensator *c, const double *reference, double reading)
{
    int i, j;
    memset(c, 0, sizeof *c);
    memcpy(c->p, first, sizeof first);
    c->scale = 1.0;
    for (i = 0; i < PAST; i++) {
        const double v = reference[1], a = reference[2], back = v * a > 0.0 ? least(i * h, v / a) : 0.0;
        c->past[i][POSITION] = reference[0] - back * (v - 0.5 * a * back);
        c->past[i][VELOCITY] = v - a * back;
    }
    if (isfinite(reading))
        c->x[DEVIATION] = reading - reference[0];
    c->covariance[0][0] = noise;
    for (i = 0; i < 1 + K; i++)
        c->covariance[DISTURBANCE + i][DISTURBANCE + i] = spread[i] * spread[i];
    if (CELLS)
        c->covariance[N - 1][N - 1] = spread[K + SURFACE] * spread[K + SURFACE];
    for (i = 0; i < CELLS; i++)
        for (j = 0; j < CELLS; j++) {
            const double away = (i - j) / $alike, alike = exp(-0.5 * (away * away)) + (i == j ? $round_off : 0.0);
            const int force = THETA + K, share = THETA + K + CELLS;
            c->covariance[force + i][force + j] = spread[1 + K] * spread[1 + K] * alike;
            c->covariance[share + i][share + j] = spread[1 + K + CELLS] * spread[1 + K + CELLS] * alike;
        }
}

compensator_command compensator_update(compensator *c, const double reference[3], double position, double torque)
{
    const double square = reference[1] * reference[1], share = square / (square + still * still);
    double u[NU], out[OUT], m[NW][NW], now[N], variance, added;
    compensator_command command = {0.0, 0.0, 0.0};
    int pivots[NW], i, j;
    if (!(isfinite(reference[0]) && isfinite(reference[1]) && isfinite(reference[2]) && isfinite(torque)))
        return command;
    if (c->begun == 0) {
        begin(c, reference, position);
    } else {
        c->past[0][EXCESS] = torque - c->wanted;
        c->time += h;
        if ($filters && c->begun >= lag + 1.0)
            predict(c, share);
        memmove(c->past[1], c->past[0], sizeof c->past - sizeof c->past[0]);
    }
    if (c->begun < PAST) /* all that is asked of it, and a controller runs for months */
        c->begun++;
    c->past[0][POSITION] = reference[0];
    c->past[0][VELOCITY] = reference[1];
    c->past[0][ACCELERATION] = reference[2];
    if ($filters && c->begun < lag + 2.0)
        wait(c, position);
    else if ($filters)
        correct(c, position, share);
    for (i = 0; i < K; i++)
        c->p[places[i]] += share * (first[places[i]] * exp(c->x[THETA + i]) - c->p[places[i]]);
    c->feedback += share * (c->x[DISTURBANCE] - c->feedback);
    inputs(u, c->time);
    c->s[0] = reference[0];
    c->s[1] = reference[1];
    c->w[0] = reference[2];
    memset(out, 0, sizeof out);
    remember(c, u, out, m, pivots);
    newton(c->s, c->w, u, c->p, out);
    c->wanted = out[0];
    if (K)
        sensitivities(c, u, out, m, pivots);
    newton(c->s, c->w, u, known, out);
    added = c->wanted - (out[0] - friction(c->s, c->w, u, known));
    c->past[0][FRICTION] = friction(c->s, c->w, u, c->p);
    for (i = 0; i < K; i++)
        c->wanted -= c->past[0][SLOPES + i] * log(c->p[places[i]] / first[places[i]]);
    memset(now, 0, sizeof now);
    slopes(c->past[0], 1.0, now);
    for (i = THETA + K; i < N; i++)
        added += now[i] * c->x[i];
    variance = 0.0;
    for (i = DISTURBANCE; i < N; i++)
        if (now[i] != 0.0)
            for (j = DISTURBANCE; j < N; j++)
                variance += now[i] * now[j] * c->covariance[i][j];
    command.torque = least(most(gain_of_all * (added + c->feedback), -limit), limit);
    variance = $z95 * sqrt(most(variance * c->scale, 0.0));
    command.low = command.torque - variance;
    command.high = command.torque + variance;
    return command;
}
