/* The acquisition in C of the bench `languages`. The header of bin/languages.rs describes the protocol. */
#define _POSIX_C_SOURCE 200809L
#include "at_rest.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define TIMEOUT_NS 5000000000ull

static uint64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

/* The duration of one round trip [ns]; 0 if it failed. */
static uint64_t round_trip(isotherm_acquisition *acquisition)
{
    isotherm_raw_sample *sample;
    isotherm_compensated_increment increment;
    isotherm_code code;
    uint64_t sent = now();
    if (isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
        return 0;
    uint64_t session = sample->session, sequence = sample->sequence;
    *sample = at_rest;
    sample->session = session;
    sample->sequence = sequence;
    if (isotherm_send(acquisition, sample) != ISOTHERM_OK)
        return 0;
    unsigned turns = 0;
    while ((code = isotherm_receive(acquisition, &increment)) == ISOTHERM_NONE) {
#if defined(__x86_64__) || defined(__i386__)
        __builtin_ia32_pause();
#endif
        if (++turns % 65536 == 0 && now() - sent > TIMEOUT_NS)
            return 0;
    }
    return code == ISOTHERM_OK ? now() - sent : 0;
}

int main(int count, char **words)
{
    isotherm_acquisition *acquisition;
    isotherm_options options = {.domain = count == 5 ? words[4] : NULL, .timeout_ns = TIMEOUT_NS};
    char line[64];
    if (count != 5 || isotherm_acquisition_connect(words[2], &options, &acquisition) != ISOTHERM_OK) {
        fprintf(stderr, "round_trip.c: %s\n", count == 5 ? isotherm_error_message() : "--imu ID --domain NAME");
        return 1;
    }
    puts("ready");
    fflush(stdout);
    while (fgets(line, sizeof line, stdin) != NULL) {
        size_t trips = strncmp(line, "go ", 3) == 0 ? strtoul(line + 3, NULL, 10) : 0;
        uint64_t *times = malloc((trips + 1) * sizeof *times);
        for (size_t i = 0; times != NULL && i < trips; i++) {
            times[i] = round_trip(acquisition);
            if (times[i] == 0) {
                fprintf(stderr, "round_trip.c: no answer; %s\n", isotherm_error_message());
                return 1;
            }
        }
        if (times == NULL || fwrite(times, sizeof *times, trips, stdout) != trips || fflush(stdout) != 0)
            return 1;
        free(times);
    }
    isotherm_acquisition_close(acquisition);
    return 0;
}
