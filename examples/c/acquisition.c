/*
 * An acquisition process: reads samples from a recording, sends them to the service, and prints the increments as CSV.
 *
 *     acquisition IMU RECORDING.csv
 *
 * Several samples are in flight at once. None is lost when the service is restarted meanwhile. Replace next_sample() by your
 * hardware. The environment variable ISOTHERM_DOMAIN names the domain.
 */
#include <inttypes.h>
#include <isotherm.h>
#include <stdio.h>
#include <string.h>

#define SECOND 1000000000u
#define COLUMNS \
    "sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_positive,a2_negative,a2_head,a2_board," \
    "a3_positive,a3_negative,a3_head,a3_board\n"

/* Fills in a sample from the next row. Returns 1, 0 at the end of the recording, or -1 for an invalid row. */
static int next_sample(FILE *recording, isotherm_raw_sample *sample)
{
    char line[1024];
    if (fgets(line, sizeof line, recording) == NULL)
        return 0;
    uint32_t *positive = sample->positive_pulses, *negative = sample->negative_pulses;
    double *head = sample->head_temperature, *board = sample->board_temperature;
    int read = sscanf(line,
                      "%" SCNu64 ",%" SCNu64 ",%" SCNu64 ",%" SCNu32 ",%" SCNu32 ",%lf,%lf,%" SCNu32 ",%" SCNu32
                      ",%lf,%lf,%" SCNu32 ",%" SCNu32 ",%lf,%lf",
                      &sample->sequence, &sample->timestamp_ns, &sample->interval_ns, &positive[0], &negative[0], &head[0],
                      &board[0], &positive[1], &negative[1], &head[1], &board[1], &positive[2], &negative[2], &head[2], &board[2]);
    return read == 15 ? 1 : -1;
}

static void print(const isotherm_compensated_increment *increment)
{
    char flags[512];
    isotherm_flags_text(increment->flags, flags, sizeof flags);
    const double *dv = increment->velocity_increment;
    printf("%" PRIu64 ",%.17g,%.17g,%.17g,%016" PRIx64 ",%s\n", increment->sequence, dv[0], dv[1], dv[2], increment->table, flags);
}

/* Waits up to the time-out for the next increment, and prints it. */
static isotherm_code take(isotherm_acquisition *acquisition, uint64_t timeout_ns)
{
    isotherm_compensated_increment increment;
    isotherm_code code = isotherm_receive_timeout(acquisition, timeout_ns, &increment);
    if (code == ISOTHERM_OK)
        print(&increment);
    else if (code == ISOTHERM_NONE && timeout_ns > 0)
        fprintf(stderr, "acquisition: the service has not answered for %u s\n", (unsigned)(timeout_ns / SECOND));
    return code;
}

/* Sends all samples and receives all increments. */
static isotherm_code run(isotherm_acquisition *acquisition, FILE *recording, int *row)
{
    isotherm_code code;
    for (;;) {
        isotherm_raw_sample *sample;
        if ((code = isotherm_loan(acquisition, &sample)) != ISOTHERM_OK)
            return code;
        if ((*row = next_sample(recording, sample)) <= 0) {
            isotherm_discard(acquisition, sample);
            break;
        }
        /* While the service's queue is full the sample stays on loan. Each increment that is received makes room in the queue. */
        while ((code = isotherm_send(acquisition, sample)) == ISOTHERM_FULL)
            if ((code = take(acquisition, 20ull * SECOND)) != ISOTHERM_OK)
                return code;
        if (code != ISOTHERM_OK)
            return code;
        while ((code = take(acquisition, 0)) == ISOTHERM_OK)
            ;
        if (code != ISOTHERM_NONE)
            return code;
    }
    while (isotherm_in_flight(acquisition) > 0)
        if ((code = take(acquisition, 20ull * SECOND)) != ISOTHERM_OK)
            return code;
    return ISOTHERM_OK;
}

int main(int count, char **words)
{
    char header[1024];
    if (count != 3) {
        fprintf(stderr, "usage: %s IMU RECORDING.csv\n", words[0]);
        return 64;
    }
    FILE *recording = fopen(words[2], "r");
    if (recording == NULL) {
        perror(words[2]);
        return 74;
    }
    if (fgets(header, sizeof header, recording) == NULL || strcmp(header, COLUMNS) != 0) {
        fprintf(stderr, "%s: the columns must be, in this order: %s", words[2], COLUMNS);
        fclose(recording);
        return 65;
    }
    int row = 0;
    isotherm_acquisition *acquisition;
    isotherm_code code = isotherm_acquisition_connect(words[1], NULL, 5ull * SECOND, &acquisition);
    if (code == ISOTHERM_OK) {
        puts("sequence,a1_dv,a2_dv,a3_dv,table,flags");
        code = run(acquisition, recording, &row);
    }
    if (code < 0)
        fprintf(stderr, "acquisition: %s\n", isotherm_error_message());
    if (row < 0)
        fprintf(stderr, "%s: a row is none of a recording\n", words[2]);
    isotherm_acquisition_close(acquisition);
    fclose(recording);
    return row < 0 ? 65 : code == ISOTHERM_OK ? 0 : 1;
}
