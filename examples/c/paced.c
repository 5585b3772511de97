/*
 * An acquisition at the pace of its hardware: 400 readings a second, each sent when its control period ends.
 *
 *     paced IMU [PERIODS [CORE PRIORITY]]
 *
 * Start with this program. It loses no control period while the service is away or replaced, and says so where one is lost all the same.
 * Replace wait_for_period() and read_imu() by your hardware, and use() by your navigation. The resolution is that of the table,
 * here of examples/tables/imu-mems.toml. An IMU that counts pulses writes them, and the measured gate length, into the sample itself. CORE
 * and PRIORITY (SCHED_FIFO, 1 to 99) are for a machine that has a core to spare; they need rights, see docs/operate.md. The environment
 * variable ISOTHERM_DOMAIN names the domain.
 */
#define _POSIX_C_SOURCE 199309L /* nanosleep */
#include <inttypes.h>
#include <isotherm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PERIOD_NS 2500000u
/* An increment that takes longer is late. It leaves time for the rest of the period. */
#define TIMEOUT_NS 1000000u
/* Temperature is measured every 40th period: ten times a second. */
#define TEMPERATURE_PERIODS 40u
/* prepare() takes some ten microseconds in cold caches. */
#define PREPARE_NS 100000u

static uint64_t began, increments;
static double velocity[3], angle[3];

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

/* Specific force [m/s2] and angular rate [rad/s], the means over the period; returns the temperature [degC]. */
static double read_imu(uint64_t period, double specific_force[3], double angular_rate[3])
{
    double turn = (double)(period % 100);
    memcpy(specific_force, (double[]){0.1 + 1e-4 * turn, -0.3, 9.80665}, 3 * sizeof(double));
    memcpy(angular_rate, (double[]){0.01, 1e-5 * turn - 0.02, 7.292e-5}, 3 * sizeof(double));
    return 31.25 + 1e-6 * (double)period;
}

/* What the hardware has measured. Temperature that is not set is NaN, every other field 0. */
static isotherm_code latch(isotherm_acquisition *acquisition, isotherm_raw_sample *sample, uint64_t period, uint64_t end)
{
    static double temperature;
    static uint64_t measured;
    double force[3], rate[3], now = read_imu(period, force, rate);
    if (period % TEMPERATURE_PERIODS == 0) {
        /* A new measurement. The library keeps its lag; a value that is only repeated is not given again. */
        temperature = now;
        measured = end;
        isotherm_reading_of_all(acquisition, temperature, measured);
    }
    sample->timestamp_ns = end;
    sample->interval_ns = PERIOD_NS;
    sample->telemetry_ns = measured;
    for (unsigned axis = 0; axis < 3; axis++) {
        sample->accelerometers.head_temperature[axis] = sample->accelerometers.board_temperature[axis] = temperature;
        sample->gyroscopes.head_temperature[axis] = sample->gyroscopes.board_temperature[axis] = temperature;
    }
    return isotherm_fill(acquisition, sample, force, rate);
}

/* Navigation: a value counts if it is finite, whatever the flags say. */
static void use(const isotherm_compensated_increment *increment)
{
    increments++;
    if ((increment->flags & ISOTHERM_MASK_LOST) != 0)
        fprintf(stderr, "%" PRIu64 ": time is missing before this increment\n", increment->sequence);
    if ((increment->flags & (ISOTHERM_MASK_INVALID | ISOTHERM_MASK_DEGRADED)) != 0) {
        char names[1024];
        isotherm_flags_text(increment->flags, names, sizeof names);
        fprintf(stderr, "%" PRIu64 ": %s\n", increment->sequence, names);
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        if (isfinite(increment->velocity_increment[axis]))
            velocity[axis] += increment->velocity_increment[axis];
        if (isfinite(increment->angle_increment[axis]))
            angle[axis] += increment->angle_increment[axis];
    }
}

static isotherm_code run(isotherm_acquisition *acquisition, uint64_t periods)
{
    static isotherm_compensated_increment arrived[512];
    isotherm_raw_sample *sample;
    isotherm_code code = ISOTHERM_OK;
    size_t count;
    began = isotherm_monotonic_ns();
    for (uint64_t period = 0; period < periods && code == ISOTHERM_OK; period++) {
        uint64_t end = wait_for_period(acquisition, period);
        if ((code = isotherm_loan(acquisition, &sample)) != ISOTHERM_OK)
            return code;
        if (latch(acquisition, sample, period, end) == ISOTHERM_OK) {
            /* While the service has no room, or is away, the sample waits, and a later call sends it. */
            code = isotherm_exchange(acquisition, sample, TIMEOUT_NS, arrived, 512, &count);
            for (size_t i = 0; code == ISOTHERM_OK && i < count; i++)
                use(&arrived[i]);
        } else {
            fprintf(stderr, "%s\n", isotherm_error_message());
            code = isotherm_discard(acquisition, sample); /* a gap for every reader */
        }
    }
    /* The last periods: wait for a service that is away, 20 s. */
    for (int turn = 0; turn < 20 && code == ISOTHERM_OK; turn++) {
        while ((code = isotherm_receive_timeout(acquisition, 1000000000u, arrived)) == ISOTHERM_OK)
            use(arrived);
        if (code == ISOTHERM_NONE)
            code = ISOTHERM_OK;
        if (isotherm_kept(acquisition) == 0 && isotherm_in_flight(acquisition) == 0)
            break;
    }
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
    options.accelerometer_resolution = 1e-6; /* m/s2 */
    options.gyroscope_resolution = 1e-7;     /* rad/s */
    isotherm_acquisition *acquisition = NULL;
    if (code == ISOTHERM_OK)
        code = isotherm_acquisition_connect(words[1], &options, &acquisition);
    if (code == ISOTHERM_OK)
        code = run(acquisition, periods);
    if (code < 0)
        fprintf(stderr, "paced: %s\n", isotherm_error_message());
    uint64_t lost = isotherm_lost(acquisition) + isotherm_kept(acquisition);
    if (isotherm_acquisition_close(acquisition) == ISOTHERM_LOST)
        fprintf(stderr, "paced: %s\n", isotherm_error_message());
    printf("%" PRIu64 " periods: %" PRIu64 " increments, %" PRIu64 " lost\n", periods, increments, lost);
    printf("velocity %.9f %.9f %.9f m/s\n", velocity[0], velocity[1], velocity[2]);
    printf("angle %.9f %.9f %.9f rad\n", angle[0], angle[1], angle[2]);
    return code < 0;
}
