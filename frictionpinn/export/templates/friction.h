/* $title.
 * Written by frictionpinn $version. C99, needs libm alone, allocates nothing, keeps no state of its own.
 * Units: force $force, slip $slip, time s. The friction force opposes positive slip velocity. */
#ifndef FRICTION_H
#define FRICTION_H

/* Time between the samples that the network was trained on, s. */
#define FRICTION_INTERVAL $interval
$law$network
#endif
