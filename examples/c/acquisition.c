/*
 * An acquisition process: reads samples from a recording, sends them to the service, and prints the increments as CSV.
 *
 *     acquisition IMU RECORDING.csv [STATE [unknown]]
 *
 * Several samples are in flight at once. None is lost when the service is restarted meanwhile. Replace next_sample() and the test
 * whether temperature is new by your hardware. STATE is the file in which the lag of the temperature is kept: a program that is started
 * again with it goes on as if the temperature had gone straight on in the pause. Where there is no such file, the IMU is taken to be soaked;
 * with `unknown`, increments are flagged until three time constants have passed. The environment variable ISOTHERM_DOMAIN names the domain.
 */
#include <errno.h>
#include <inttypes.h>
#include <isotherm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SECOND 1000000000u
#define COLUMNS \
    "sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_positive,a2_negative,a2_head,a2_board," \
    "a3_positive,a3_negative,a3_head,a3_board"
#define GYROSCOPES \
    ",g1_positive,g1_negative,g1_head,g1_board,g2_positive,g2_negative,g2_head,g2_board,g3_positive,g3_negative,g3_head,g3_board"

/* Three accelerometers; six sensors where the recording has gyroscopes. */
static unsigned sensors;
static const char *state;
static int unknown;

static isotherm_triad *triad_of(isotherm_raw_sample *sample, unsigned sensor)
{
    return sensor < 3 ? &sample->accelerometers : &sample->gyroscopes;
}

/* Fills in a sample from the next row. Returns 1, 0 at the end of the recording, or -1 for an invalid row. */
static int next_sample(FILE *recording, isotherm_raw_sample *sample)
{
    char line[2048];
    int used;
    if (fgets(line, sizeof line, recording) == NULL)
        return 0;
    if (sscanf(line, "%" SCNu64 ",%" SCNu64 ",%" SCNu64 "%n", &sample->sequence, &sample->timestamp_ns, &sample->interval_ns, &used) != 3)
        return -1;
    const char *rest = line + used;
    for (unsigned sensor = 0; sensor < sensors; sensor++, rest += used) {
        isotherm_triad *triad = triad_of(sample, sensor);
        unsigned axis = sensor % 3;
        if (sscanf(rest, ",%" SCNu32 ",%" SCNu32 ",%lf,%lf%n", &triad->positive_pulses[axis], &triad->negative_pulses[axis],
                   &triad->head_temperature[axis], &triad->board_temperature[axis], &used) != 4)
            return -1;
    }
    return 1;
}

/* What is saved: the state, and the start of the machine that its times are of. */
typedef struct {
    uint64_t boot;
    isotherm_lag lag;
} saved_lag;

/* Writes the state under a temporary name and renames it, so that the file is complete whenever this process ends. */
static isotherm_code save(isotherm_acquisition *acquisition)
{
    saved_lag saved = {.boot = isotherm_boot()};
    char name[4096];
    isotherm_code code = isotherm_save_lag(acquisition, &saved.lag);
    if (code != ISOTHERM_OK || state == NULL)
        return code;
    snprintf(name, sizeof name, "%s.new", state);
    FILE *file = fopen(name, "wb");
    int complete = file != NULL && fwrite(&saved, sizeof saved, 1, file) == 1;
    if (file == NULL || fclose(file) != 0 || !complete || rename(name, state) != 0)
        perror(name);
    return ISOTHERM_OK;
}

/* Goes on with a state that a predecessor of this process has saved. Without one the IMU is soaked, if nothing else is said. */
static isotherm_code restore(isotherm_acquisition *acquisition)
{
    saved_lag saved;
    if (state == NULL)
        return isotherm_soaked(acquisition);
    FILE *file = fopen(state, "rb");
    if (file == NULL && errno == ENOENT && !unknown)
        return isotherm_soaked(acquisition);
    int complete = file != NULL && fread(&saved, sizeof saved, 1, file) == 1;
    if (file != NULL)
        fclose(file);
    /* The times of another start of the machine are of another clock. */
    if (complete && saved.boot == isotherm_boot())
        return isotherm_restore_lag(acquisition, &saved.lag);
    fprintf(stderr, "%s: no state of the lag since the machine's start; increments are flagged lag-unknown for three time constants\n", state);
    return isotherm_forget_lag(acquisition);
}

/* Feeds the temperatures that have been measured since the last sample. In this recording those are the ones that have changed; your
   hardware knows when it has measured. A value that is only repeated from sample to sample is no reading. */
static isotherm_code feed(isotherm_acquisition *acquisition, isotherm_raw_sample *sample)
{
    static double last[ISOTHERM_SENSORS];
    static int any;
    isotherm_code code = ISOTHERM_OK;
    int fresh = 0;
    for (unsigned sensor = 0; sensor < sensors && code == ISOTHERM_OK; sensor++) {
        double head = triad_of(sample, sensor)->head_temperature[sensor % 3];
        if (!any || head != last[sensor]) {
            code = isotherm_reading(acquisition, sensor, head, sample->timestamp_ns);
            last[sensor] = head;
            fresh = 1;
        }
    }
    any = 1;
    return code == ISOTHERM_OK && fresh ? save(acquisition) : code;
}

static void print(const isotherm_compensated_increment *increment)
{
    char flags[1024];
    isotherm_flags_text(increment->flags, flags, sizeof flags);
    const double *dv = increment->velocity_increment, *da = increment->angle_increment;
    printf("%" PRIu64 ",%.17g,%.17g,%.17g,", increment->sequence, dv[0], dv[1], dv[2]);
    if (sensors > 3)
        printf("%.17g,%.17g,%.17g,", da[0], da[1], da[2]);
    printf("%016" PRIx64 ",%s\n", increment->table, flags);
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
    isotherm_code code = restore(acquisition);
    while (code == ISOTHERM_OK) {
        isotherm_raw_sample *sample;
        if ((code = isotherm_loan(acquisition, &sample)) != ISOTHERM_OK)
            return code;
        if ((*row = next_sample(recording, sample)) <= 0) {
            isotherm_cancel(acquisition, sample);
            break;
        }
        if ((code = feed(acquisition, sample)) != ISOTHERM_OK)
            return code;
        /* While the service's queue is full the sample stays on loan. Each increment that is received makes room in the queue. */
        while ((code = isotherm_send(acquisition, sample)) == ISOTHERM_FULL)
            if ((code = take(acquisition, 20ull * SECOND)) != ISOTHERM_OK)
                return code;
        if (code != ISOTHERM_OK)
            return code;
        while ((code = take(acquisition, 0)) == ISOTHERM_OK)
            ;
        code = code == ISOTHERM_NONE ? ISOTHERM_OK : code;
    }
    while (code == ISOTHERM_OK && isotherm_in_flight(acquisition) > 0)
        code = take(acquisition, 20ull * SECOND);
    return code;
}

int main(int count, char **words)
{
    char header[1024];
    unknown = count == 5 && strcmp(words[4], "unknown") == 0;
    if (count < 3 || count > 5 || (count == 5 && !unknown)) {
        fprintf(stderr, "usage: %s IMU RECORDING.csv [STATE [unknown]]\n", words[0]);
        return 64;
    }
    state = words[3];
    FILE *recording = fopen(words[2], "r");
    if (recording == NULL) {
        perror(words[2]);
        return 74;
    }
    if (fgets(header, sizeof header, recording) != NULL)
        sensors = strcmp(header, COLUMNS "\n") == 0 ? 3 : strcmp(header, COLUMNS GYROSCOPES "\n") == 0 ? 6 : 0;
    if (sensors == 0) {
        fprintf(stderr, "%s: the columns must be, in this order: %s, and for gyroscopes %s\n", words[2], COLUMNS, GYROSCOPES);
        fclose(recording);
        return 65;
    }
    int row = 0;
    /* The serial number of your unit: the service flags samples that are of another one than the table. */
    isotherm_options options = {.timeout_ns = 5ull * SECOND, .serial = getenv("SERIAL")};
    isotherm_acquisition *acquisition;
    isotherm_code code = isotherm_acquisition_connect(words[1], &options, &acquisition);
    if (code == ISOTHERM_OK) {
        printf("sequence,a1_dv,a2_dv,a3_dv,%stable,flags\n", sensors > 3 ? "g1_da,g2_da,g3_da," : "");
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
