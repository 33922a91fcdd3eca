#include "sentence.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBER_LENGTH = 40, MOST_DIGITS = 17 };

/* Where the next character goes; what has no room is left off. */
struct pen {
    char *at, *end;
};

static void put(struct pen *pen, const char *text, size_t length)
{
    const size_t room = (size_t)(pen->end - pen->at);
    if (length > room)
        length = room;
    memcpy(pen->at, text, length);
    pen->at += length;
    *pen->at = '\0';
}

static void put_text(struct pen *pen, const char *text)
{
    put(pen, text, strlen(text));
}

/* The digits of a finite number, so many or the fewest that give it back, and the power of ten of
 * the first one. The host's locale may write another decimal point, so that only digits are taken
 * from what C prints. */
static int digits_of(double x, int wanted, char digits[MOST_DIGITS])
{
    char written[NUMBER_LENGTH];
    int count = 0, length = wanted ? wanted - 1 : 0;
    do {
        snprintf(written, sizeof written, "%.*e", length, x);
        ++length;
    } while (!wanted && length < MOST_DIGITS && strtod(written, NULL) != x);
    for (const char *c = written; *c && *c != 'e'; ++c)
        if (*c >= '0' && *c <= '9')
            digits[count++] = *c;
    while (wanted && count > 1 && digits[count - 1] == '0')
        digits[--count] = '\0';
    return atoi(strchr(written, 'e') + 1);
}

static void put_zeros(struct pen *pen, int count)
{
    for (int i = 0; i < count; ++i)
        put_text(pen, "0");
}

/* A double as Python's repr writes it, 0.001, 120.0, 1e-05, 1.5e+16, or as its format g with a
 * number of digits does, without the ".0". */
static void put_number(struct pen *pen, double x, int wanted)
{
    const int longest = wanted ? wanted : 16;
    char digits[MOST_DIGITS + 1] = "", exponent[NUMBER_LENGTH];
    int power;
    size_t count;
    if (!isfinite(x)) {
        put_text(pen, isnan(x) ? "nan" : x < 0.0 ? "-inf" : "inf");
        return;
    }
    power = digits_of(fabs(x), wanted, digits);
    count = strlen(digits);
    if (signbit(x))
        put_text(pen, "-");
    if (power < -4 || power >= longest) {
        put(pen, digits, 1);
        put_text(pen, count > 1 ? "." : "");
        put(pen, digits + 1, count - 1);
        snprintf(exponent, sizeof exponent, "e%c%02d", power < 0 ? '-' : '+', abs(power));
        put_text(pen, exponent);
    } else if (power < 0) {
        put_text(pen, "0.");
        put_zeros(pen, -1 - power);
        put(pen, digits, count);
    } else if (count <= (size_t)power + 1) {
        put(pen, digits, count);
        put_zeros(pen, power + 1 - (int)count);
        put_text(pen, wanted ? "" : ".0");
    } else {
        put(pen, digits, (size_t)power + 1);
        put_text(pen, ".");
        put(pen, digits + power + 1, count - (size_t)power - 1);
    }
}

static void write_sentence(struct sentence *sentence, const char *format, va_list arguments)
{
    struct pen pen = {sentence->text, sentence->text + SENTENCE_LENGTH - 1};
    char whole[NUMBER_LENGTH];
    for (const char *c = format; *c; ++c) {
        if (*c != '%') {
            put(&pen, c, 1);
        } else if (*++c == 's') {
            put_text(&pen, va_arg(arguments, const char *));
        } else if (*c == 'r') {
            put_number(&pen, va_arg(arguments, double), 0);
        } else if (*c >= '1' && *c <= '9') {
            put_number(&pen, va_arg(arguments, double), *c - '0');
        } else {
            snprintf(whole, sizeof whole, "%d", va_arg(arguments, int));
            put_text(&pen, whole);
        }
    }
}

void say(struct sentence *sentence, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_sentence(sentence, format, arguments);
    va_end(arguments);
}

bool refuse(struct report *report, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_sentence(&report->refusal, format, arguments);
    va_end(arguments);
    return false;
}

void warn(struct report *report, const char *format, ...)
{
    va_list arguments;
    if (report->warnings == MOST_WARNINGS)
        return;
    va_start(arguments, format);
    write_sentence(&report->warning[report->warnings++], format, arguments);
    va_end(arguments);
}
