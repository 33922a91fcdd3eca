/* Sentences for people: why something is refused or doubted, with numbers as Python writes them. */
#ifndef SENTENCE_H
#define SENTENCE_H

#include <stdbool.h>

enum { SENTENCE_LENGTH = 1536, MOST_WARNINGS = 9 };

struct sentence {
    char text[SENTENCE_LENGTH];
};

/* What a call has to say when it ends: at most one refusal, and warnings. */
struct report {
    struct sentence refusal;
    int warnings;
    struct sentence warning[MOST_WARNINGS];
};

/* Write a sentence: %s text, %d a whole number, %r a double in the shortest digits that give it, %3
 * and %9 in so many digits, as C's and Python's format g. */
void say(struct sentence *sentence, const char *format, ...);
/* Write the refusal and return false. */
bool refuse(struct report *report, const char *format, ...);
void warn(struct report *report, const char *format, ...);

#endif
