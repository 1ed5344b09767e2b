/* $title.
 * Written by frictionpinn $version. C99, needs libm alone, allocates nothing, keeps no state of its own.
 * Units: force $force, slip $slip, time s. The friction force opposes positive slip velocity. */
#ifndef FRICTION_H
#define FRICTION_H
$parts
#endif
