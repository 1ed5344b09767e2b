
/* ---- the law $name ---- */
const friction_law friction_law_identified = {$values};

double friction_law_force(const friction_law *p, double v_slip, double N, double z, double zdot)
{
$force_unused$force
}

double friction_law_capacity(const friction_law *p, double v_slip, double N)
{
$capacity_unused$capacity
}

double friction_law_bristle_rate(const friction_law *p, double v_slip, double N, double z)
{
$rate_unused$rate
}

static double bristle_slope(const friction_law *p, double v_slip, double N, double z)
{
$slope_unused$slope
}

double friction_law_step(const friction_law *p, double *z, double v_slip, double N, double dt)
{
    const double x = bristle_slope(p, v_slip, N, *z) * dt;
    const double share = fabs(x) < 1e-8 ? 1.0 + x / 2.0 : expm1(x) / x;
    const double step = dt * share * friction_law_bristle_rate(p, v_slip, N, *z);
    if (N <= 0.0) { /* without a load nothing bends, and nothing is carried */
        *z = 0.0;
        return 0.0;
    }
    if (fabs(step) <= DBL_MAX) *z += step; /* a sample that is no number leaves the bristle as it is */
    return friction_law_force(p, v_slip, N, *z, friction_law_bristle_rate(p, v_slip, N, *z));
}
