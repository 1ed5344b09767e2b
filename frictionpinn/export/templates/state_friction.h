/* $title.
 * Written by frictionpinn $version. C99, needs libm alone, allocates nothing, keeps no state of its own.
 * Units: force $force, slip $slip, time s. The friction force opposes positive slip velocity. */
#ifndef FRICTION_H
#define FRICTION_H

#define FRICTION_STATES $states /* deflections of bristles; start them at 0 */

/* Force and rates of the states, from slip velocity, normal force (its magnitude) and states: for a solver. */
double friction_rates(double v_slip, double N, const double z[FRICTION_STATES], double rate[FRICTION_STATES]);

/* Advance the states by dt seconds at constant v_slip and N, and return the force at the end; stable for any dt where
 * the bristles saturate exponentially, else for steps in which the contact slips less than a bristle's reach. */
double friction_step(double z[FRICTION_STATES], double v_slip, double N, double dt);

#endif
