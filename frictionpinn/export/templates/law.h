
/* ---- the law $name: $formula ---- */
typedef struct {
$fields
} friction_law;

/* The parameters that were identified. */
extern const friction_law friction_law_identified;

/* Force, from slip velocity, normal force (its magnitude), bristle state z and its rate. */
double friction_law_force(const friction_law *p, double v_slip, double N, double z, double zdot);

/* Magnitude of the dry friction in steady sliding. */
double friction_law_capacity(const friction_law *p, double v_slip, double N);

/* Rate of the bristle state. */
double friction_law_bristle_rate(const friction_law *p, double v_slip, double N, double z);

/* Advance *z (start: 0) by dt seconds at constant v_slip and N, and return the force at the end. The update is the
 * exponential one: exact for these laws and stable for any dt, however stiff the bristle. To try a step, hand over
 * a copy of z. */
double friction_law_step(const friction_law *p, double *z, double v_slip, double N, double dt);
