
/* ---- the network $name ---- */
#define FRICTION_INTERVAL $interval /* s, between the samples that it was trained on */
#define FRICTION_SAMPLES $length /* that its longest window sees */
#define FRICTION_SIGNALS $count
#ifndef FRICTION_STRIDE
#define FRICTION_STRIDE 1 /* calls per FRICTION_INTERVAL; define it to call more often than the network was trained */
#endif
#define FRICTION_KEPT (FRICTION_SAMPLES > 1 ? (FRICTION_SAMPLES - 1) * FRICTION_STRIDE : 1)

/* What the network sees at one instant. */
typedef struct {
$fields
} friction_signals;

/* The past that its windows see. */
typedef struct {
    long count;
    double past[FRICTION_KEPT][$kept];
} friction_network;

/* Begin a trial: before its first sample, every signal is taken to have been what it was there. */
void friction_network_reset(friction_network *network);

/* Force at the instant now, the past being what was kept; keeps nothing, so a solver may try as often as it likes. */
double friction_network_force(const friction_network *network, const friction_signals *now);

/* Keep the instant now. */
void friction_network_keep(friction_network *network, const friction_signals *now);

/* Both. */
double friction_network_step(friction_network *network, const friction_signals *now);
