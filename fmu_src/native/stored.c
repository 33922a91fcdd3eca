#include "stored.h"

#include <string.h>

#include "identity.h"

enum { MARK_LENGTH = 40 };

struct seal {
    char guid[MARK_LENGTH];
    uint64_t size, digest;
};

/* FNV-1a: enough against a file cut short or changed. */
static uint64_t digest_of(const unsigned char *bytes, size_t size)
{
    uint64_t digest = 14695981039346656037u;
    for (size_t i = 0; i < size; ++i)
        digest = (digest ^ bytes[i]) * 1099511628211u;
    return digest;
}

size_t stored_size(void)
{
    return sizeof(struct seal) + STATE_SIZE;
}

void store(const void *state, void *bytes)
{
    struct seal seal;
    memset(&seal, 0, sizeof seal);
    strncpy(seal.guid, model_guid, MARK_LENGTH - 1);
    seal.size = STATE_SIZE;
    seal.digest = digest_of(state, STATE_SIZE);
    memcpy(bytes, &seal, sizeof seal);
    memcpy((unsigned char *)bytes + sizeof seal, state, STATE_SIZE);
}

bool is_stored(const void *bytes, size_t size)
{
    struct seal seal;
    if (size != stored_size())
        return false;
    memcpy(&seal, bytes, sizeof seal);
    return strncmp(seal.guid, model_guid, MARK_LENGTH) == 0 && seal.size == STATE_SIZE &&
           seal.digest == digest_of(stored_state(bytes), STATE_SIZE);
}

const void *stored_state(const void *bytes)
{
    return (const unsigned char *)bytes + sizeof(struct seal);
}
