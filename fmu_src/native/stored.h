/* The state of a slave as bytes: only the FMU that wrote them takes them back, and only unharmed. */
#ifndef STORED_H
#define STORED_H

#include "slave.h"

/* Values are looked at a few at a time, so that lists of any length need no memory of their own. */
enum { CHUNK = 64 };

size_t stored_size(void);
/* Write a state, of STATE_SIZE bytes, as stored_size bytes. */
void store(const void *state, void *bytes);
/* Whether bytes are such a state; it follows what comes before it. */
bool is_stored(const void *bytes, size_t size);
const void *stored_state(const void *bytes);

#endif
