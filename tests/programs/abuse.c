/*
 * Calls the C interface in every wrong way and checks the answers: abuse IMU SERVICE_PID. Exits with 0 if all are as documented.
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <float.h>
#include <isotherm.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#define SECOND 1000000000ull
#define TIMEOUT_NS (20 * SECOND)

#include "check.h"

static const char *imu;
static const isotherm_options patient = {.timeout_ns = TIMEOUT_NS}, impatient = {.timeout_ns = ISOTHERM_NO_WAIT};

static void null_everywhere(isotherm_acquisition *acquisition)
{
    isotherm_acquisition *none = (isotherm_acquisition *)1;
    isotherm_reader *no_reader = (isotherm_reader *)1;
    isotherm_raw_sample *sample, copy = {0};
    isotherm_compensated_increment increment;
    GIVES(isotherm_acquisition_connect(NULL, NULL, &none), ISOTHERM_ERROR_NULL, "NULL");
    CHECK(none == NULL);
    GIVES(isotherm_acquisition_connect(imu, NULL, NULL), ISOTHERM_ERROR_NULL, "NULL");
    GIVES(isotherm_reader_new(NULL, NULL, &no_reader), ISOTHERM_ERROR_NULL, "NULL");
    CHECK(no_reader == NULL);
    CHECK(isotherm_reader_connect(imu, NULL, 0, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_loan(NULL, &sample) == ISOTHERM_ERROR_NULL && isotherm_loan(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_send(NULL, &copy) == ISOTHERM_ERROR_NULL && isotherm_send(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_discard(NULL, &copy) == ISOTHERM_ERROR_NULL && isotherm_discard(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_receive(NULL, &increment) == ISOTHERM_ERROR_NULL && isotherm_receive(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_receive_timeout(NULL, 1, &increment) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_receive_timeout(acquisition, TIMEOUT_NS, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_compensate(NULL, &copy, 1, &increment) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_compensate(acquisition, NULL, 1, &increment) == ISOTHERM_ERROR_NULL);
    /* Without a place for the increment the sample is not sent: it is still on loan. */
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
    CHECK(isotherm_compensate(acquisition, sample, 1, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_discard(acquisition, sample) == ISOTHERM_OK);
    CHECK(isotherm_begin_session(NULL) == ISOTHERM_ERROR_NULL);
    isotherm_lag lag;
    CHECK(isotherm_reading(NULL, 0, 1.0, 1) == ISOTHERM_ERROR_NULL && isotherm_lag_ns(NULL) == 0);
    CHECK(isotherm_save_lag(NULL, &lag) == ISOTHERM_ERROR_NULL && isotherm_save_lag(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_restore_lag(NULL, &lag) == ISOTHERM_ERROR_NULL && isotherm_restore_lag(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_prepare(NULL) == ISOTHERM_ERROR_NULL && isotherm_prepare(acquisition) == ISOTHERM_OK);
    CHECK(isotherm_depth(NULL) == 0 && isotherm_in_flight(NULL) == 0 && isotherm_session(NULL) == 0);
    CHECK(isotherm_reader_receive(NULL, &increment) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_reader_receive_timeout(NULL, 1, &increment) == ISOTHERM_ERROR_NULL);
    int descriptor;
    uint64_t age_ns;
    CHECK(isotherm_reader_descriptor(NULL, &descriptor) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_reader_heartbeat_age(NULL, &age_ns) == ISOTHERM_ERROR_NULL);
    CHECK(!isotherm_reader_is_connected(NULL) && isotherm_reader_repeats(NULL) == 0);
    CHECK(isotherm_merge(NULL, NULL, &copy) == ISOTHERM_ERROR_NULL && isotherm_merge(NULL, &copy, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_merge(acquisition, NULL, &copy) == ISOTHERM_ERROR_NULL && isotherm_cancel(NULL, &copy) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_lost(NULL) == 0 && isotherm_dropped_answers(NULL) == 0);
    CHECK(isotherm_flags_text(1, NULL, 0) == strlen("a1-head-below") && isotherm_flags_text(1, NULL, 9) == strlen("a1-head-below"));
    CHECK(isotherm_acquisition_close(NULL) == ISOTHERM_OK && isotherm_reader_close(NULL) == ISOTHERM_OK);
}

static void wrong_names(void)
{
    isotherm_acquisition *none;
    isotherm_reader *no_reader;
    const char *names[] = {"", "IMU", "a b", "\xff\xfe", "0123456789abcdefghijklmnopqrstuvwxyz"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        isotherm_options nowhere = {.domain = names[i], .timeout_ns = TIMEOUT_NS};
        GIVES(isotherm_acquisition_connect(names[i], &patient, &none), ISOTHERM_ERROR_NAME, "not a valid name");
        GIVES(isotherm_acquisition_connect(imu, &nowhere, &none), ISOTHERM_ERROR_NAME, "domain");
        GIVES(isotherm_reader_new(names[i], NULL, &no_reader), ISOTHERM_ERROR_NAME, "not a valid name");
        CHECK(none == NULL && no_reader == NULL);
    }
    isotherm_options elsewhere = {.domain = "nobody-here"};
    /* A time-out of 0 is the default, 5 s. */
    uint64_t begun = isotherm_monotonic_ns();
    GIVES(isotherm_acquisition_connect(imu, &elsewhere, &none), ISOTHERM_ERROR_NO_SERVICE, "isotherm serve");
    CHECK(isotherm_monotonic_ns() - begun >= 5000000000);
    GIVES(isotherm_acquisition_connect("imu-x", &impatient, &none), ISOTHERM_ERROR_NO_SUCH_IMU, "isotherm status");
    GIVES(isotherm_reader_connect("imu-x", NULL, ISOTHERM_NO_WAIT, &no_reader), ISOTHERM_ERROR_NO_SUCH_IMU, "isotherm status");
    GIVES(isotherm_acquisition_connect(imu, &impatient, &none), ISOTHERM_ERROR_OCCUPIED, "pid");
    double lags[] = {0.05, 86401, -2, NAN, INFINITY};
    for (size_t i = 0; i < sizeof lags / sizeof *lags; i++) {
        isotherm_options wrong = {.timeout_ns = TIMEOUT_NS, .lag_s = lags[i]};
        GIVES(isotherm_acquisition_connect(imu, &wrong, &none), ISOTHERM_ERROR_VALUE, "give 0.1 to 86400 s");
    }
    const uint64_t sizes[] = {1, sizeof patient - 1, sizeof patient + 8};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        isotherm_options wrong = {.size = sizes[i], .timeout_ns = TIMEOUT_NS};
        GIVES(isotherm_acquisition_connect(imu, &wrong, &none), ISOTHERM_ERROR_VALUE, "sizeof(isotherm_options)");
    }
    isotherm_options serial = {.timeout_ns = TIMEOUT_NS, .serial = "SN \xff"};
    GIVES(isotherm_acquisition_connect(imu, &serial, &none), ISOTHERM_ERROR_VALUE, "UTF-8");
}

/* A loan can be sent or discarded once. */
static void samples(isotherm_acquisition *acquisition)
{
    isotherm_raw_sample *sample, *loans[ISOTHERM_LOANS], own = {0};
    isotherm_compensated_increment increment;
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
    sample->interval_ns = 2500000;
    CHECK(isotherm_compensate(acquisition, sample, TIMEOUT_NS, &increment) == ISOTHERM_OK);
    CHECK(increment.interval_ns == 2500000 && increment.session == isotherm_session(acquisition));
    GIVES(isotherm_send(acquisition, sample), ISOTHERM_ERROR_NOT_ON_LOAN, "not on loan");
    CHECK(isotherm_compensate(acquisition, sample, TIMEOUT_NS, &increment) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(isotherm_discard(acquisition, sample) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(isotherm_send(acquisition, &own) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(isotherm_send(acquisition, (isotherm_raw_sample *)1) == ISOTHERM_ERROR_NOT_ON_LOAN);

    for (int i = 0; i < ISOTHERM_LOANS; i++)
        CHECK(isotherm_loan(acquisition, &loans[i]) == ISOTHERM_OK);
    GIVES(isotherm_loan(acquisition, &sample), ISOTHERM_ERROR_LOANS, "4 samples");
    CHECK(isotherm_send(acquisition, loans[2]) == ISOTHERM_OK);
    /* Each loan has its own sequence. One that is below the last sent cannot be sent any more. */
    GIVES(isotherm_send(acquisition, loans[0]), ISOTHERM_ERROR_SEQUENCE, "sequence");
    CHECK(loans[0]->sequence + 1 == loans[1]->sequence && loans[1]->sequence + 2 == loans[3]->sequence);
    CHECK(isotherm_send(acquisition, loans[3]) == ISOTHERM_OK);
    CHECK(isotherm_send(acquisition, loans[3]) == ISOTHERM_ERROR_NOT_ON_LOAN);
    const uint64_t lost = isotherm_lost(acquisition);
    CHECK(isotherm_discard(acquisition, loans[0]) == ISOTHERM_OK && isotherm_discard(acquisition, loans[1]) == ISOTHERM_OK);
    CHECK(isotherm_lost(acquisition) == lost && lost >= 2);
    GIVES(isotherm_begin_session(acquisition), ISOTHERM_ERROR_IN_FLIGHT, "2 samples");
    for (int i = 0; i < 2; i++)
        CHECK(isotherm_receive_timeout(acquisition, TIMEOUT_NS, &increment) == ISOTHERM_OK);
    /* What is discarded leaves a hole, what is cancelled does not. */
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
    const uint64_t next = sample->sequence;
    CHECK(isotherm_cancel(acquisition, sample) == ISOTHERM_OK && isotherm_cancel(acquisition, sample) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK && sample->sequence == next && isotherm_discard(acquisition, sample) == ISOTHERM_OK);
    CHECK(isotherm_lost(acquisition) == lost + 1);
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK && sample->sequence == next + 1);
    CHECK(isotherm_compensate(acquisition, sample, TIMEOUT_NS, &increment) == ISOTHERM_OK && (increment.flags & ISOTHERM_FLAG_GAP) != 0);
    uint64_t before = isotherm_session(acquisition);
    CHECK(isotherm_begin_session(acquisition) == ISOTHERM_OK && isotherm_session(acquisition) != before);
    CHECK(isotherm_receive(acquisition, &increment) == ISOTHERM_NONE);
}

static void full_queue(isotherm_acquisition *acquisition)
{
    isotherm_raw_sample *sample, *later, largest, copy;
    isotherm_compensated_increment increment;
    uint64_t sequence = 0;
    isotherm_code code;
    do {
        CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
        sample->interval_ns = 1000;
        sample->accelerometers.positive_pulses[0] = 7;
        sequence = sample->sequence;
        CHECK(isotherm_prepare(acquisition) == ISOTHERM_OK);
    } while ((code = isotherm_send(acquisition, sample)) == ISOTHERM_OK);
    GIVES(code, ISOTHERM_FULL, "full");
    CHECK(isotherm_in_flight(acquisition) == isotherm_depth(acquisition) && isotherm_depth(acquisition) > 1);
    /* The sample is still on loan and unchanged; the next sample is merged into it. */
    CHECK(sample->sequence == sequence && sample->interval_ns == 1000);
    CHECK(isotherm_loan(acquisition, &later) == ISOTHERM_OK);
    later->interval_ns = 500;
    later->accelerometers.positive_pulses[0] = 3;
    later->gyroscopes.negative_pulses[2] = 5;
    later->timestamp_ns = 42;
    CHECK(isotherm_merge(acquisition, sample, later) == ISOTHERM_OK && isotherm_discard(acquisition, later) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(sample->interval_ns == 1500 && sample->accelerometers.positive_pulses[0] == 10 && sample->timestamp_ns == 42);
    CHECK(sample->gyroscopes.negative_pulses[2] == 5);
    largest = *sample;
    largest.accelerometers.positive_pulses[0] = UINT32_MAX;
    GIVES(isotherm_merge(acquisition, sample, &largest), ISOTHERM_ERROR_MERGE, "32 bits");
    CHECK(sample->accelerometers.positive_pulses[0] == 10);
    /* A sample is not added to itself, and a loan stays one. */
    copy = largest;
    GIVES(isotherm_merge(NULL, &largest, &largest), ISOTHERM_ERROR_MERGE, "itself");
    CHECK(memcmp(&copy, &largest, sizeof copy) == 0);
    copy = *sample;
    GIVES(isotherm_merge(acquisition, sample, sample), ISOTHERM_ERROR_MERGE, "itself");
    CHECK(memcmp(&copy, sample, sizeof copy) == 0);
    /* An interval that is not known stays unknown. */
    copy.interval_ns = 0;
    CHECK(isotherm_merge(NULL, &copy, sample) == ISOTHERM_OK && copy.interval_ns == 0);
    CHECK(isotherm_send(acquisition, sample) == ISOTHERM_FULL);
    /* It is kept, and nothing overtakes it. */
    CHECK(isotherm_keep(acquisition, sample) == ISOTHERM_OK && isotherm_kept(acquisition) == 1);
    CHECK(isotherm_keep(acquisition, sample) == ISOTHERM_ERROR_NOT_ON_LOAN && isotherm_keep(acquisition, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_send_kept(acquisition) == ISOTHERM_OK && isotherm_kept(acquisition) == 1);
    CHECK(isotherm_receive_timeout(acquisition, TIMEOUT_NS, &increment) == ISOTHERM_OK);
    CHECK(isotherm_loan(acquisition, &later) == ISOTHERM_OK && later->sequence == sequence + 1);
    GIVES(isotherm_send(acquisition, later), ISOTHERM_FULL, "kept");
    later->sequence = sequence;
    GIVES(isotherm_keep(acquisition, later), ISOTHERM_ERROR_SEQUENCE, "kept");
    CHECK(isotherm_cancel(acquisition, later) == ISOTHERM_OK);
    GIVES(isotherm_begin_session(acquisition), ISOTHERM_ERROR_IN_FLIGHT, "kept");
    CHECK(isotherm_send_kept(acquisition) == ISOTHERM_OK && isotherm_kept(acquisition) == 0 && isotherm_kept(NULL) == 0);
    while (isotherm_in_flight(acquisition) > 0)
        CHECK(isotherm_receive_timeout(acquisition, TIMEOUT_NS, &increment) == ISOTHERM_OK);
    CHECK(increment.sequence == sequence && increment.interval_ns == 1500 && increment.timestamp_ns == 42);
}

/* Whether every thread of a process has stopped. */
static bool has_stopped(pid_t process)
{
    char path[300], line[300] = "";
    snprintf(path, sizeof path, "/proc/%d/task", (int)process);
    DIR *threads = opendir(path);
    CHECK(threads != NULL);
    bool stopped = true;
    struct dirent *thread;
    while (stopped && (thread = readdir(threads)) != NULL) {
        if (thread->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "/proc/%d/task/%.20s/stat", (int)process, thread->d_name);
        FILE *file = fopen(path, "r");
        CHECK(file != NULL && fgets(line, sizeof line, file) != NULL && fclose(file) == 0);
        const char *name_end = strrchr(line, ')');
        stopped = name_end != NULL && name_end[2] == 'T';
    }
    CHECK(closedir(threads) == 0);
    return stopped;
}

/* A round trip times out while the service is stopped. */
static void time_out(isotherm_acquisition *acquisition, pid_t service)
{
    isotherm_raw_sample *sample;
    isotherm_compensated_increment increment;
    CHECK(kill(service, SIGSTOP) == 0);
    /* The signal reaches one thread after another: until then the others answer. */
    while (!has_stopped(service))
        sched_yield();
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
    GIVES(isotherm_compensate(acquisition, sample, 1000000, &increment), ISOTHERM_TIMEOUT, "no answer");
    CHECK(isotherm_in_flight(acquisition) == 1 && isotherm_receive(acquisition, &increment) == ISOTHERM_NONE);
    CHECK(isotherm_send(acquisition, sample) == ISOTHERM_ERROR_NOT_ON_LOAN);
    CHECK(kill(service, SIGCONT) == 0);
    CHECK(isotherm_receive_timeout(acquisition, TIMEOUT_NS, &increment) == ISOTHERM_OK);
}

static atomic_bool over;

static void *receive_until_over(void *acquisition)
{
    isotherm_compensated_increment increment;
    while (!over) {
        isotherm_code code = isotherm_receive_timeout(acquisition, 10000000, &increment);
        if (code != ISOTHERM_NONE && code != ISOTHERM_ERROR_BUSY)
            return NULL;
    }
    return acquisition;
}

static void *round_trip(void *acquisition)
{
    isotherm_raw_sample *sample;
    isotherm_compensated_increment increment;
    if (isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
        return NULL;
    return isotherm_compensate(acquisition, sample, TIMEOUT_NS, &increment) == ISOTHERM_OK ? acquisition : NULL;
}

/* Any thread may call, but only one at a time. */
static void threads(isotherm_acquisition *acquisition)
{
    pthread_t thread;
    void *done;
    isotherm_compensated_increment increment;
    isotherm_code code;
    CHECK(pthread_create(&thread, NULL, receive_until_over, acquisition) == 0);
    while ((code = isotherm_receive(acquisition, &increment)) == ISOTHERM_NONE)
        ;
    GIVES(code, ISOTHERM_ERROR_BUSY, "another call");
    while ((code = isotherm_begin_session(acquisition)) == ISOTHERM_OK)
        ;
    CHECK(code == ISOTHERM_ERROR_BUSY);
    over = true;
    CHECK(pthread_join(thread, &done) == 0 && done == acquisition);
    for (int i = 0; i < 100; i++) {
        CHECK(pthread_create(&thread, NULL, round_trip, acquisition) == 0);
        CHECK(pthread_join(thread, &done) == 0 && done == acquisition);
        CHECK(round_trip(acquisition) == acquisition);
    }
}

/* A child with a copy of the memory, without the C library's knowledge. */
static pid_t clone_it(void)
{
    return (pid_t)syscall(SYS_clone, (long)SIGCHLD, 0L, 0L, 0L, 0L);
}

static void ended_well(pid_t child)
{
    int status;
    CHECK(child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

/* A child can neither use nor damage its parent's handles, and neither can its own child. */
static void child_of(pid_t (*make)(void), isotherm_acquisition *acquisition, isotherm_reader *reader)
{
    isotherm_compensated_increment increment;
    isotherm_raw_sample *on_loan;
    CHECK(isotherm_loan(acquisition, &on_loan) == ISOTHERM_OK);
    pid_t child = make();
    if (child == 0) {
        isotherm_raw_sample *sample;
        isotherm_reader *own;
        GIVES(isotherm_loan(acquisition, &sample), ISOTHERM_ERROR_FORKED, "forked");
        CHECK(isotherm_send(acquisition, on_loan) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_compensate(acquisition, on_loan, 1, &increment) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_discard(acquisition, on_loan) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_reader_receive(reader, &increment) == ISOTHERM_ERROR_FORKED);
        int descriptor;
        CHECK(isotherm_reader_descriptor(reader, &descriptor) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_depth(acquisition) == 0 && isotherm_reading(acquisition, 0, 1.0, 1) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_acquisition_close(acquisition) == ISOTHERM_ERROR_FORKED && isotherm_reader_close(reader) == ISOTHERM_ERROR_FORKED);
        if (make != fork)
            exit(0); /* without the C library's knowledge it cannot connect either */
        CHECK(isotherm_reader_connect(imu, NULL, TIMEOUT_NS, &own) == ISOTHERM_OK);
        pid_t grandchild = make();
        if (grandchild == 0) {
            CHECK(isotherm_reader_receive(own, &increment) == ISOTHERM_ERROR_FORKED);
            CHECK(isotherm_reader_receive(reader, &increment) == ISOTHERM_ERROR_FORKED);
            exit(0);
        }
        ended_well(grandchild);
        CHECK(isotherm_reader_receive(own, &increment) == ISOTHERM_NONE);
        CHECK(isotherm_reader_receive(reader, &increment) == ISOTHERM_ERROR_FORKED);
        CHECK(isotherm_reader_close(own) == ISOTHERM_OK);
        exit(0);
    }
    ended_well(child);
    CHECK(isotherm_discard(acquisition, on_loan) == ISOTHERM_OK);
    CHECK(round_trip(acquisition) == acquisition);
    CHECK(isotherm_reader_receive_timeout(reader, TIMEOUT_NS, &increment) == ISOTHERM_OK);
}

/* Any numbers are harmless as readings and as a kept state. */
static void lag(isotherm_acquisition *acquisition)
{
    isotherm_lag kept, any;
    isotherm_raw_sample *sample;
    isotherm_compensated_increment increment;
    GIVES(isotherm_reading(acquisition, ISOTHERM_SENSORS, 1.0, 1), ISOTHERM_ERROR_VALUE, "0 to 5");
    GIVES(isotherm_reading(acquisition, UINT32_MAX, 1.0, 1), ISOTHERM_ERROR_VALUE, "0 to 5");
    CHECK(isotherm_save_lag(acquisition, &kept) == ISOTHERM_OK && isnan(kept.sensors[5].lagged));
    double values[] = {2.5, NAN, INFINITY, -INFINITY, DBL_MAX, -DBL_MAX, DBL_MIN / 2, 0, 2.5};
    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        for (uint32_t sensor = 0; sensor < ISOTHERM_SENSORS; sensor++)
            CHECK(isotherm_reading(acquisition, sensor, values[i], i % 2 == 0 ? UINT64_MAX - i : i) == ISOTHERM_OK);
    CHECK(isotherm_save_lag(acquisition, &kept) == ISOTHERM_OK && kept.sensors[5].telemetry == 2.5 && isfinite(kept.sensors[5].lagged));
    for (int byte = 0; byte < 256; byte++) {
        memset(&any, byte, sizeof any);
        CHECK(isotherm_restore_lag(acquisition, &any) == ISOTHERM_OK);
        CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
        sample->interval_ns = 2500000;
        CHECK(isotherm_compensate(acquisition, sample, TIMEOUT_NS, &increment) == ISOTHERM_OK);
        CHECK(isotherm_reading(acquisition, 0, 2.5, (uint64_t)byte) == ISOTHERM_OK);
    }
    CHECK(isotherm_restore_lag(acquisition, &kept) == ISOTHERM_OK && isotherm_save_lag(acquisition, &any) == ISOTHERM_OK);
    CHECK(memcmp(&any, &kept, sizeof kept) == 0);
}

static void values(void)
{
    char text[16];
    CHECK(isotherm_flags_text(0, text, sizeof text) == 1 && strcmp(text, "-") == 0);
    CHECK(isotherm_flags_text(ISOTHERM_FLAG_G3_RATE, text, sizeof text) == 7 && strcmp(text, "g3-rate") == 0);
    CHECK(isotherm_flags_text(ISOTHERM_FLAG_GAP | ISOTHERM_FLAG_LATE, text, sizeof text) == 8 && strcmp(text, "gap|late") == 0);
    memset(text, 'x', sizeof text);
    CHECK(isotherm_flags_text(UINT64_MAX, text, 5) > 512 && strcmp(text, "a1-h") == 0 && text[5] == 'x');
    CHECK(isotherm_flags_text(UINT64_MAX, text, 1) < 1024 && text[0] == 0);
    CHECK(isotherm_device("SN 42") == 0x46a7426ef29cc83b && isotherm_device(" SN 42\n") == isotherm_device("SN 42"));
    CHECK(isotherm_device("") == 0 && isotherm_device(NULL) == 0 && isotherm_device("\xff") == 0);
    CHECK(strcmp(isotherm_version(), ISOTHERM_VERSION) == 0);
    uint64_t before = isotherm_monotonic_ns();
    CHECK(before > 0 && isotherm_monotonic_ns() >= before);
    CHECK(isotherm_realtime(-1, 0, false, 0) == ISOTHERM_OK && isotherm_realtime(-1, 0, false, 1000) == ISOTHERM_OK);
    GIVES(isotherm_realtime(-2, 0, false, 0), ISOTHERM_ERROR_REALTIME, "core");
    GIVES(isotherm_realtime(100000, 0, false, 0), ISOTHERM_ERROR_REALTIME, "core");
    GIVES(isotherm_realtime(-1, 1000, false, 0), ISOTHERM_ERROR_REALTIME, "SCHED_FIFO");
}

int main(int count, char **words)
{
    CHECK(count == 3 && strcmp(isotherm_error_message(), "") == 0);
    imu = words[1];
    isotherm_acquisition *acquisition;
    isotherm_reader *reader;
    int descriptor;
    CHECK(isotherm_reader_new(imu, "nobody-here", &reader) == ISOTHERM_OK && !isotherm_reader_is_connected(reader));
    GIVES(isotherm_reader_descriptor(reader, &descriptor), ISOTHERM_ERROR_NO_SERVICE, "no service");
    CHECK(isotherm_reader_close(reader) == ISOTHERM_OK);
    /* The service is there: nothing is missed from now on. */
    CHECK(isotherm_reader_new(imu, NULL, &reader) == ISOTHERM_OK && isotherm_reader_is_connected(reader));
    CHECK(isotherm_reader_descriptor(reader, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_reader_heartbeat_age(reader, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_acquisition_connect(imu, &patient, &acquisition) == ISOTHERM_OK);
    null_everywhere(acquisition);
    wrong_names();
    samples(acquisition);
    full_queue(acquisition);
    time_out(acquisition, (pid_t)atoi(words[2]));
    lag(acquisition);
    isotherm_compensated_increment increment;
    CHECK(isotherm_reader_receive(reader, &increment) == ISOTHERM_OK && increment.interval_ns == 2500000);
    threads(acquisition);
    while (isotherm_reader_receive(reader, &increment) == ISOTHERM_OK)
        ;
    child_of(fork, acquisition, reader);
    child_of(clone_it, acquisition, reader);
    values();
    /* Closing the acquisition releases its loans. */
    isotherm_raw_sample *sample;
    CHECK(isotherm_loan(acquisition, &sample) == ISOTHERM_OK);
    CHECK(isotherm_lost(acquisition) > 0 && isotherm_reader_close(reader) == ISOTHERM_OK);
    GIVES(isotherm_acquisition_close(acquisition), ISOTHERM_LOST, "control periods that were not sent");
    return 0;
}
