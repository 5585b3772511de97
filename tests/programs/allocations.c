/*
 * Counts how often round trips allocate or free memory: allocations IMU TRIPS. Prints the count, which should be 0.
 *
 * Samples that take longer than 4 ms, because the kernel suspended one of the processes, are not counted: the library then
 * checks whether the service has been replaced, and that query of the transport allocates.
 */
#include <isotherm.h>
#include <stdio.h>
#include <stdlib.h>

#define UNINTERRUPTED_NS 4000000u

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *block, size_t size);
extern void __libc_free(void *block);

/* Not atomic: this program has one thread. */
static unsigned long counted;

void *malloc(size_t size) { counted++; return __libc_malloc(size); }
void *calloc(size_t count, size_t size) { counted++; return __libc_calloc(count, size); }
void *realloc(void *block, size_t size) { counted++; return __libc_realloc(block, size); }
void free(void *block) { counted++; __libc_free(block); }

int main(int count, char **words)
{
    isotherm_acquisition *acquisition;
    isotherm_raw_sample *sample;
    isotherm_compensated_increment increment;
    isotherm_options options = {.timeout_ns = 20000000000ull, .serial = "SN 42", .lag_s = 240};
    if (count != 3 || isotherm_acquisition_connect(words[1], &options, &acquisition) != ISOTHERM_OK)
        return 1;
    if (isotherm_soaked(acquisition) != ISOTHERM_OK)
        return 1;
    unsigned long connecting = counted, allocations = 0, trips = strtoul(words[2], NULL, 10);
    /* The first 1000 trips make the connections and let the queues grow to their final size. */
    for (unsigned long trip = 0; trip < 1000 + trips; trip++) {
        unsigned long before = counted;
        uint64_t started = isotherm_monotonic_ns();
        isotherm_code code = isotherm_prepare(acquisition);
        if (code == ISOTHERM_OK)
            code = isotherm_loan(acquisition, &sample);
        /* A reading allocates nothing either, while the time constant stays. */
        double head = 2.5 + (double)(trip % 10) / 100;
        for (uint32_t sensor = 0; sensor < ISOTHERM_SENSORS; sensor++)
            if (isotherm_reading(acquisition, sensor, head, trip * 1000000000u) != ISOTHERM_OK)
                return 1;
        if (code == ISOTHERM_OK)
            code = isotherm_discard(acquisition, sample);
        if (code != ISOTHERM_OK || isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
            return 1;
        sample->interval_ns = 2500000;
        for (int axis = 0; axis < 3; axis++)
            sample->accelerometers.head_temperature[axis] = sample->gyroscopes.head_temperature[axis] = head;
        if (isotherm_send(acquisition, sample) != ISOTHERM_OK)
            return 1;
        while ((code = isotherm_receive(acquisition, &increment)) == ISOTHERM_NONE)
            ;
        /* The table has transient terms, and they are not left out. */
        if (code != ISOTHERM_OK || (increment.flags & ISOTHERM_FLAG_LAG_UNKNOWN) != 0)
            return 1;
        if (trip >= 1000 && isotherm_monotonic_ns() - started < UNINTERRUPTED_NS)
            allocations += counted - before;
    }
    isotherm_acquisition_close(acquisition);
    /* Check of the method: connecting allocates. */
    if (connecting == 0)
        return 1;
    printf("%lu\n", allocations);
    return 0;
}
