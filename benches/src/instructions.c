/* The acquisition of the bench `instructions`: sends samples one by one, and receives each answer when it is certainly there. */
#define _POSIX_C_SOURCE 200809L
#include "at_rest.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define TIMEOUT_NS 20000000000ull

int main(int count, char **words)
{
    isotherm_acquisition *acquisition;
    isotherm_reader *reader;
    isotherm_options options = {.timeout_ns = TIMEOUT_NS};
    if (count != 3 || isotherm_acquisition_connect(words[1], &options, &acquisition) != ISOTHERM_OK
        || isotherm_reader_connect(words[1], NULL, TIMEOUT_NS, &reader) != ISOTHERM_OK) {
        fprintf(stderr, "instructions.c: %s\n", count == 3 ? isotherm_error_message() : "IMU COUNT");
        return 1;
    }
    for (unsigned long left = strtoul(words[2], NULL, 10); left > 0; left--) {
        isotherm_raw_sample *sample;
        isotherm_compensated_increment increment;
        if (isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
            break;
        uint64_t session = sample->session, sequence = sample->sequence;
        *sample = at_rest;
        sample->session = session;
        sample->sequence = sequence;
        if (isotherm_send(acquisition, sample) != ISOTHERM_OK)
            break;
        /* When the reader has it, the service has sent it, or is just sending it, to all: one receive is enough, or nearly always. */
        if (isotherm_reader_receive_timeout(reader, TIMEOUT_NS, &increment) != ISOTHERM_OK)
            break;
        isotherm_code code;
        do
            nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
        while ((code = isotherm_receive(acquisition, &increment)) == ISOTHERM_NONE);
        if (code != ISOTHERM_OK)
            break;
        if (left == 1) {
            isotherm_reader_close(reader);
            isotherm_acquisition_close(acquisition);
            return 0;
        }
    }
    fprintf(stderr, "instructions.c: no answer; %s\n", isotherm_error_message());
    return 1;
}
