/*
 * An acquisition at the pace of its hardware: 400 samples a second, each sent when its control period ends.
 *
 *     paced IMU [PERIODS [CORE PRIORITY]]
 *
 * Start with this program. It loses no control period while the service is replaced, and says so where one is lost all the same. Replace
 * wait_for_period() and latch() by your hardware, and use() by your navigation. CORE and PRIORITY (SCHED_FIFO, 1 to 99) are for a machine
 * that has a core to spare; they need rights, see docs/operate.md. The environment variable ISOTHERM_DOMAIN names the domain.
 */
#define _POSIX_C_SOURCE 199309L /* nanosleep */
#include <inttypes.h>
#include <isotherm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define PERIOD_NS 2500000u
/* An increment that takes longer is late. It leaves time for the rest of the period. */
#define TIMEOUT_NS 1000000u
/* Telemetry is measured every 40th period: ten times a second. */
#define TELEMETRY_PERIODS 40u
/* prepare() takes some ten microseconds in cold caches. */
#define PREPARE_NS 100000u

static uint64_t began, answered, late, merged, lost;
static double velocity[3];

static void sleep_until(uint64_t time_ns)
{
    uint64_t now = isotherm_monotonic_ns();
    if (now >= time_ns)
        return;
    struct timespec left = {(time_t)((time_ns - now) / 1000000000u), (long)((time_ns - now) % 1000000000u)};
    nanosleep(&left, NULL);
}

/* Waits for the end of a period. While it waits it warms the way of the sample. Returns the time of the end on the hardware's clock. */
static uint64_t wait_for_period(isotherm_acquisition *acquisition, uint64_t period)
{
    uint64_t end = began + (period + 1) * PERIOD_NS;
    sleep_until(end - PREPARE_NS);
    if (isotherm_monotonic_ns() < end)
        isotherm_prepare(acquisition);
    sleep_until(end);
    return end;
}

/* What the hardware has counted and measured. Every field that is not set is 0. */
static void latch(isotherm_acquisition *acquisition, isotherm_raw_sample *sample, uint64_t period, uint64_t end)
{
    static double head;
    static uint64_t measured;
    if (period % TELEMETRY_PERIODS == 0) {
        /* A new measurement. The library keeps its lag; a value that is only repeated is not given again. */
        head = 2.5 + 1e-6 * (double)period;
        measured = end;
        for (unsigned sensor = 0; sensor < 3; sensor++)
            isotherm_reading(acquisition, sensor, head, measured);
    }
    sample->timestamp_ns = end;
    sample->interval_ns = PERIOD_NS; /* the measured gate length */
    sample->telemetry_ns = measured;
    for (unsigned axis = 0; axis < 3; axis++) {
        sample->accelerometers.positive_pulses[axis] = 140 + axis;
        sample->accelerometers.head_temperature[axis] = sample->accelerometers.board_temperature[axis] = head;
    }
}

/* Navigation: a value counts if it is finite, whatever the flags say. */
static void use(const isotherm_compensated_increment *increment)
{
    if ((increment->flags & ISOTHERM_MASK_LOST) != 0)
        fprintf(stderr, "%" PRIu64 ": time is missing before this increment\n", increment->sequence);
    if ((increment->flags & (ISOTHERM_MASK_INVALID | ISOTHERM_MASK_DEGRADED)) != 0) {
        char names[1024];
        isotherm_flags_text(increment->flags, names, sizeof names);
        fprintf(stderr, "%" PRIu64 ": %s\n", increment->sequence, names);
    }
    for (unsigned axis = 0; axis < 3; axis++)
        if (isfinite(increment->velocity_increment[axis]))
            velocity[axis] += increment->velocity_increment[axis];
}

/* Adds a period to the one that waits, or gives up the one that waits. Either way `*waiting` is the sample to send. */
static isotherm_code add(isotherm_acquisition *acquisition, isotherm_raw_sample **waiting, isotherm_raw_sample *sample)
{
    if (*waiting == NULL) {
        *waiting = sample;
        return ISOTHERM_OK;
    }
    isotherm_code code = isotherm_merge(acquisition, *waiting, sample);
    if (code == ISOTHERM_OK)
        merged++;
    if (code != ISOTHERM_ERROR_MERGE)
        return code;
    /* A sum does not fit: over an hour without a service. Its sequence is left out, which is a gap for every reader. */
    code = isotherm_discard(acquisition, *waiting);
    *waiting = sample;
    return code;
}

/* Sends what waits and takes all increments that are there. A full queue leaves the sample to the next period. */
static isotherm_code exchange(isotherm_acquisition *acquisition, isotherm_raw_sample **waiting)
{
    isotherm_compensated_increment increment;
    isotherm_code code = isotherm_compensate(acquisition, *waiting, TIMEOUT_NS, &increment);
    if (code == ISOTHERM_OK) {
        answered++;
        use(&increment);
    }
    if (code == ISOTHERM_OK || code == ISOTHERM_TIMEOUT)
        *waiting = NULL; /* sent; after a time-out its increment comes from isotherm_receive */
    if (code < 0)
        return code;
    while ((code = isotherm_receive(acquisition, &increment)) == ISOTHERM_OK) {
        late++;
        use(&increment);
    }
    return code == ISOTHERM_NONE ? ISOTHERM_OK : code;
}

static isotherm_code run(isotherm_acquisition *acquisition, uint64_t periods)
{
    isotherm_raw_sample *waiting = NULL, *sample;
    isotherm_compensated_increment increment;
    isotherm_code code = ISOTHERM_OK;
    began = isotherm_monotonic_ns();
    for (uint64_t period = 0; period < periods && code == ISOTHERM_OK; period++) {
        uint64_t end = wait_for_period(acquisition, period);
        if ((code = isotherm_loan(acquisition, &sample)) != ISOTHERM_OK)
            return code;
        latch(acquisition, sample, period, end);
        if ((code = add(acquisition, &waiting, sample)) == ISOTHERM_OK)
            code = exchange(acquisition, &waiting);
    }
    /* The last periods: wait for a service that is away, 20 s. */
    for (int turn = 0; turn < 20000 && code == ISOTHERM_OK && (waiting != NULL || isotherm_in_flight(acquisition) > 0); turn++) {
        if (waiting != NULL)
            code = exchange(acquisition, &waiting);
        else if ((code = isotherm_receive_timeout(acquisition, 1000000, &increment)) == ISOTHERM_OK) {
            late++;
            use(&increment);
        }
        if (code == ISOTHERM_NONE)
            code = ISOTHERM_OK;
        if (waiting != NULL)
            sleep_until(isotherm_monotonic_ns() + 1000000);
    }
    lost = isotherm_lost(acquisition);
    return code;
}

int main(int count, char **words)
{
    if (count != 2 && count != 3 && count != 5) {
        fprintf(stderr, "usage: %s IMU [PERIODS [CORE PRIORITY]]\n", words[0]);
        return 64;
    }
    uint64_t periods = count > 2 ? strtoull(words[2], NULL, 10) : 4000;
    /* Before connecting, so that all memory is resident. Without arguments only sleeps become exact, which needs no right. */
    isotherm_code code = count > 3 ? isotherm_realtime(atoi(words[3]), atoi(words[4]), true, 1) : isotherm_realtime(-1, 0, false, 1);
    isotherm_options options = {.size = sizeof options, .serial = getenv("SERIAL")};
    isotherm_acquisition *acquisition = NULL;
    if (code == ISOTHERM_OK)
        code = isotherm_acquisition_connect(words[1], &options, &acquisition);
    if (code == ISOTHERM_OK)
        code = run(acquisition, periods);
    if (code < 0)
        fprintf(stderr, "paced: %s\n", isotherm_error_message());
    if (isotherm_acquisition_close(acquisition) == ISOTHERM_LOST)
        fprintf(stderr, "paced: %s\n", isotherm_error_message());
    printf("%" PRIu64 " periods: %" PRIu64 " answered in time, %" PRIu64 " late, %" PRIu64 " merged, %" PRIu64 " lost\n", periods, answered, late,
           merged, lost);
    printf("velocity %.9g %.9g %.9g m/s\n", velocity[0], velocity[1], velocity[2]);
    return code < 0;
}
