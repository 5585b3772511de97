/*
 * A signal interrupts a call in the middle of an allocation: handler IMU. Its handler calls with the same handle, and
 * with none; that must neither allocate nor free. Nor must the errors of the sending path.
 */
#define _GNU_SOURCE
#include "check.h"
#include <signal.h>
#include <stdbool.h>

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *block, size_t size);
extern void __libc_free(void *block);

/* Of each thread: a helper thread of the library allocates as it likes. */
static __thread volatile unsigned long counted;
/* Whether the next allocation is interrupted. */
static __thread volatile sig_atomic_t interrupted;

static void count(void)
{
    counted++;
    if (interrupted) {
        interrupted = false;
        raise(SIGUSR1);
    }
}

void *malloc(size_t size) { count(); return __libc_malloc(size); }
void *calloc(size_t number, size_t size) { count(); return __libc_calloc(number, size); }
void *realloc(void *block, size_t size) { count(); return __libc_realloc(block, size); }
void free(void *block) { counted++; __libc_free(block); }

static isotherm_reader *reader;
static volatile sig_atomic_t signals, wrong;

static void handler(int number)
{
    (void)number;
    const unsigned long before = counted;
    isotherm_compensated_increment increment;
    isotherm_raw_sample sample = ISOTHERM_RAW_SAMPLE_INIT, largest = sample;
    sample.accelerometers.positive_pulses[0] = 1;
    largest.accelerometers.positive_pulses[0] = UINT32_MAX;
    wrong += isotherm_merge(NULL, &sample, &largest) != ISOTHERM_ERROR_MERGE;
    wrong += isotherm_reader_receive(reader, &increment) != ISOTHERM_ERROR_BUSY;
    wrong += strstr(isotherm_error_message(), "another call is in this handle") == NULL;
    wrong += counted != before;
    signals++;
}

int main(int words_count, char **words)
{
    isotherm_reader *none;
    isotherm_acquisition *acquisition;
    isotherm_raw_sample *first, *second;
    isotherm_compensated_increment increment;
    struct sigaction action = {.sa_handler = handler};
    CHECK(words_count == 2 && sigaction(SIGUSR1, &action, NULL) == 0);
    CHECK(isotherm_reader_new(words[1], NULL, &reader) == ISOTHERM_OK);
    /* The message before is an allocated one. */
    GIVES(isotherm_reader_new("no blanks", NULL, &none), ISOTHERM_ERROR_NAME, "blanks");
    CHECK(isotherm_reader_is_connected(reader));
    /* The reader looks at the status for the first time, which allocates. */
    uint64_t age_ns;
    interrupted = true;
    CHECK(isotherm_reader_heartbeat_age(reader, &age_ns) >= ISOTHERM_OK);
    CHECK(signals == 1 && wrong == 0 && !interrupted);
    CHECK(strstr(isotherm_error_message(), "another call is in this handle") != NULL);

    isotherm_options options = {.timeout_ns = 20000000000ull};
    CHECK(isotherm_acquisition_connect(words[1], &options, &acquisition) == ISOTHERM_OK);
    GIVES(isotherm_reader_new("no blanks", NULL, &none), ISOTHERM_ERROR_NAME, "blanks");
    CHECK(isotherm_loan(acquisition, &first) == ISOTHERM_OK && isotherm_loan(acquisition, &second) == ISOTHERM_OK);
    CHECK(isotherm_send(acquisition, second) == ISOTHERM_OK);
    const unsigned long before = counted;
    CHECK(isotherm_send(acquisition, first) == ISOTHERM_ERROR_SEQUENCE);
    CHECK(isotherm_merge(acquisition, first, first) == ISOTHERM_ERROR_MERGE);
    CHECK(isotherm_discard(acquisition, second) == ISOTHERM_ERROR_NOT_ON_LOAN && counted == before);
    while (isotherm_in_flight(acquisition) > 0)
        CHECK(isotherm_receive_timeout(acquisition, 20000000000ull, &increment) == ISOTHERM_OK);
    CHECK(isotherm_acquisition_close(acquisition) == ISOTHERM_LOST && isotherm_reader_close(reader) == ISOTHERM_OK);
    return 0;
}
