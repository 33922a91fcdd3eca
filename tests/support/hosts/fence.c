/* Preloaded into a process: whoever touches memory that C++ has freed dies of it, at once.
 *
 * Every block of operator new gets pages of its own, which operator delete makes inaccessible.
 */
#include <stdlib.h>
#include <sys/mman.h>

enum { HEADER = 64, PAGE = 4096 };

/* operator new(unsigned long) */
void *_Znwm(size_t size)
{
    const size_t length = (size + HEADER + PAGE - 1) / PAGE * PAGE;
    char *start =
        mmap(NULL, length, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (start == MAP_FAILED)
        abort();
    *(size_t *)(void *)start = length;
    return start + HEADER;
}

/* operator delete(void *) */
void _ZdlPv(void *block)
{
    if (block != NULL) {
        char *start = (char *)block - HEADER;
        mprotect(start, *(size_t *)(void *)start, PROT_NONE);
    }
}

/* operator delete(void *, unsigned long) */
void _ZdlPvm(void *block, size_t size)
{
    (void)size;
    _ZdlPv(block);
}
