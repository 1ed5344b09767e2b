
/* ---- the network $name ---- */
#define FEATURES $features
#define WIDEST $widest
#define LAYERS $layers
#define INPUTS $inputs

$arrays

static double activation(double u)
{
$activation
}

static double activation_slope(double u)
{
$slope
}

/* Output of the layers for the standardised features u, both overwritten, and its rate for their rates du. */
static double forward(double *u, double *du, double *rate)
{
    double v[WIDEST], dv[WIDEST];
    int layer, i, j;
    for (layer = 0; layer < LAYERS; layer++) {
        const double *w = weight[layer];
        for (i = 0; i < size[layer + 1]; i++) {
            v[i] = bias[layer][i];
            dv[i] = 0.0;
            for (j = 0; j < size[layer]; j++) {
                v[i] += *w * u[j];
                dv[i] += *w++ * du[j];
            }
        }
        for (i = 0; i < size[layer + 1]; i++) {
            const int last = layer == LAYERS - 1;
            u[i] = last ? v[i] : activation(v[i]);
            du[i] = last ? dv[i] : activation_slope(v[i]) * dv[i];
        }
    }
    *rate = du[0];
    return u[0];
}

/* Output of the network for the features x, and its rate for their rates dx. */
static double output(const double *x, const double *dx, double *rate)
{
    double u[WIDEST], du[WIDEST], value;
    int j;
$direct}

/* Features of the past and of now; the signals stand from column first on. */
static void see(const friction_network *network, const double *now, int first, double *x)
{
    int signal, back, j;
    for (j = 0; j < FEATURES; j++)
        x[j] = 0.0;
    for (signal = 0; signal < INPUTS; signal++) {
        const int column = first + input[signal];
        for (back = 0; back < FRICTION_SAMPLES; back++) {
            const long steps = (long)back * FRICTION_STRIDE, kept = network->count;
            double value = now[column];
            if (steps > 0 && kept > 0)
                value = network->past[(steps <= kept ? kept - steps : 0) % FRICTION_KEPT][column];
            for (j = 0; j < FEATURES; j++)
                x[j] += window[signal][back][j] * value;
        }
    }
}

static void read(const friction_signals *now, double *row)
{
$read
}

void friction_network_reset(friction_network *network)
{
    network->count = 0;
}

double friction_network_force(const friction_network *network, const friction_signals *now)
{
    double row[$kept], x[FEATURES], dx[FEATURES] = {0.0}, u, rate;
    read(now, row);
    see(network, row, 0, x);
$force
}

void friction_network_keep(friction_network *network, const friction_signals *now)
{
    read(now, network->past[network->count % FRICTION_KEPT]);
    if (++network->count == 2 * (long)FRICTION_KEPT) /* so far, and no further: a controller runs for months */
        network->count = FRICTION_KEPT;
}

double friction_network_step(friction_network *network, const friction_signals *now)
{
    const double force = friction_network_force(network, now);
    friction_network_keep(network, now);
    return force;
}
