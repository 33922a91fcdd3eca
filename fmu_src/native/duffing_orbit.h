/* Where the Duffing oscillator's slow motion stands still: the periodic orbits of one tone. */
#ifndef DUFFING_ORBIT_H
#define DUFFING_ORBIT_H

#include "duffing_slow.h"

/* Q of both modes by first-order averaging, the other mode's part iterated. */
struct pair averaged_orbit(const struct slow_model *model, struct pair linear, bool upper);
/* Turn w into a point near it where the slow motion stands still; *found is false where there is no
 * stable one. */
bool fixed_point(const struct slow_model *model, struct pair linear, struct pair *w, bool *found,
                 struct report *report);

#endif
