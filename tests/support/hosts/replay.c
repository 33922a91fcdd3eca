/* Replays one script of FMI calls (play.c).
 *
 *     replay LIBPYTHON|- FMU_LIBRARY RESOURCES TOKEN < script > transcript
 *
 * LIBPYTHON is loaded first with its symbols made global, as the documentation of the FMU tells
 * hosts to do ("-" leaves it out). RESOURCES is a URI in FMI 2.0 and a path in FMI 3.0.
 */
#include <string.h>

#include "host.h"

int main(int count, char **arguments)
{
    struct session session = {.out = stdout};
    void (*release)(void) = NULL;
    void *library;
    int code;
    if (count != 5) {
        fprintf(stderr, "usage: replay LIBPYTHON|- FMU_LIBRARY RESOURCES TOKEN < script\n");
        return WRONG_SCRIPT;
    }
    session.resources = arguments[3];
    session.token = arguments[4];
    if (strcmp(arguments[1], "-") != 0)
        load_library(arguments[1], 1);
    library = load_library(arguments[2], 0);
    fmu_load(library);
    /* only pythonfmu's binary has it */
    *(void **)(&release) = symbol_if_any(library, "finalizePythonInterpreter");
    code = play(&session, stdin);
    if (code == 0 && release != NULL)
        release(); /* or its destructors touch what they have freed, when the process exits */
    return code;
}
