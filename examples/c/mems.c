/*
 * An acquisition whose IMU delivers readings, as every MEMS does: m/s2 and rad/s become a sample, and its increment becomes m/s2 and
 * rad/s again, compensated.
 *
 *     mems IMU [SAMPLES]
 *
 * Replace read_imu() by your driver. The resolution is that of the table, here of examples/tables/imu-mems.toml; the interval is your own. The pace of
 * an IMU, and what to do when the service is away: paced.c. The environment variable ISOTHERM_DOMAIN names the domain.
 */
#include <inttypes.h>
#include <isotherm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INTERVAL_NS 2500000u

/* Specific force [m/s2] and angular rate [rad/s]; returns the temperature [degC]. */
static double read_imu(uint64_t sample, double *specific_force, double *angular_rate)
{
    double turn = (double)sample / 7.0;
    memcpy(specific_force, (double[]){0.1234567, -0.2345678 - turn, 9.8012345}, 3 * sizeof(double));
    memcpy(angular_rate, (double[]){0.01234567, -turn, 0.00001234}, 3 * sizeof(double));
    return 31.25;
}

static isotherm_code exchange(isotherm_acquisition *acquisition, uint64_t number)
{
    double force[3], rate[3];
    double temperature = read_imu(number, force, rate);
    isotherm_raw_sample *sample;
    isotherm_code code = isotherm_loan(acquisition, &sample);
    if (code != ISOTHERM_OK)
        return code;
    sample->timestamp_ns = (number + 1) * INTERVAL_NS;
    sample->interval_ns = INTERVAL_NS;
    if (isotherm_fill(acquisition, sample, force, rate) != ISOTHERM_OK) {
        fprintf(stderr, "%s\n", isotherm_error_message());
        return isotherm_discard(acquisition, sample); /* a gap for every reader */
    }
    for (unsigned axis = 0; axis < 3; axis++) {
        sample->accelerometers.head_temperature[axis] = sample->accelerometers.board_temperature[axis] = temperature;
        sample->gyroscopes.head_temperature[axis] = sample->gyroscopes.board_temperature[axis] = temperature;
    }
    isotherm_compensated_increment increment;
    code = isotherm_compensate(acquisition, sample, 20000000000u, &increment);
    if (code != ISOTHERM_OK)
        return code;
    isotherm_increment_specific_force(&increment, force);
    isotherm_increment_angular_rate(&increment, rate);
    printf("%" PRIu64 ": %.9f %.9f %.9f m/s2, %.9f %.9f %.9f rad/s\n", increment.sequence, force[0], force[1], force[2], rate[0], rate[1],
           rate[2]);
    return ISOTHERM_OK;
}

int main(int count, char **words)
{
    if (count != 2 && count != 3) {
        fprintf(stderr, "usage: %s IMU [SAMPLES]\n", words[0]);
        return 64;
    }
    uint64_t samples = count == 3 ? strtoull(words[2], NULL, 10) : 8;
    const isotherm_options options = {.accelerometer_resolution = 1e-6, .gyroscope_resolution = 1e-7};
    isotherm_acquisition *acquisition = NULL;
    isotherm_code code = isotherm_acquisition_connect(words[1], &options, &acquisition);
    for (uint64_t number = 0; number < samples && code == ISOTHERM_OK; number++)
        code = exchange(acquisition, number);
    if (code != ISOTHERM_OK)
        fprintf(stderr, "mems: %s\n", isotherm_error_message());
    isotherm_acquisition_close(acquisition);
    return code != ISOTHERM_OK;
}
