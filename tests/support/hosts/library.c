/* Libraries, as POSIX and Windows load them. */
#include <stdlib.h>

#include "host.h"

#ifdef _WIN32
#include <windows.h>

static void stop(const char *name)
{
    fprintf(stderr, "%s: Windows error %lu\n", name, GetLastError());
    exit(NOTHING_LOADED);
}

void *load_library(const char *path, int everybody_sees_it)
{
    HMODULE library = LoadLibraryA(path);
    (void)everybody_sees_it;
    if (library == NULL)
        stop(path);
    return (void *)library;
}

void *symbol_if_any(void *library, const char *name)
{
    FARPROC found = library ? GetProcAddress((HMODULE)library, name) : NULL;
    return *(void **)&found;
}

void *symbol(void *library, const char *name)
{
    void *found = symbol_if_any(library, name);
    if (found == NULL)
        stop(name);
    return found;
}
#else
#include <dlfcn.h>

static void stop(void)
{
    fprintf(stderr, "%s\n", dlerror());
    exit(NOTHING_LOADED);
}

void *load_library(const char *path, int everybody_sees_it)
{
    void *library = dlopen(path, RTLD_NOW | (everybody_sees_it ? RTLD_GLOBAL : RTLD_LOCAL));
    if (library == NULL)
        stop();
    return library;
}

void *symbol_if_any(void *library, const char *name)
{
    return dlsym(library ? library : RTLD_DEFAULT, name);
}

void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL)
        stop();
    return found;
}
#endif
