/*
 * Turns readings into pulses and increments into readings, rightly and wrongly. Exits with 0 if all is as documented.
 */
#include <isotherm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

int main(int count, char **words)
{
    CHECK(count == 2);
    isotherm_options options = {.accelerometer_resolution = 1e-6, .gyroscope_resolution = 1e-7};
    isotherm_acquisition *acquisition;
    isotherm_raw_sample sample = ISOTHERM_RAW_SAMPLE_INIT, unchanged;
    double force[3] = {1.0000003, -2.0, 0.0}, rate[3] = {0.5, 0.0, -0.5}, mean[3];
    CHECK(isotherm_acquisition_connect(words[1], &options, &acquisition) == ISOTHERM_OK);
    CHECK(isotherm_fill(NULL, &sample, force, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_fill(acquisition, NULL, force, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_fill(acquisition, &sample, NULL, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_fill(acquisition, &sample, force, rate) == ISOTHERM_OK && sample.interval_ns == 2500000);
    CHECK(sample.accelerometers.positive_pulses[0] == 1000000 && sample.accelerometers.negative_pulses[1] == 2000000);
    CHECK(sample.gyroscopes.positive_pulses[0] == 5000000 && sample.gyroscopes.negative_pulses[2] == 5000000);
    /* What rounding leaves is carried: 0.3, 0.6, 0.9. */
    CHECK(isotherm_fill(acquisition, &sample, force, rate) == ISOTHERM_OK && sample.accelerometers.positive_pulses[0] == 1000001);
    /* Of twice the interval. */
    sample.interval_ns = 5000000;
    CHECK(isotherm_fill(acquisition, &sample, force, rate) == ISOTHERM_OK && sample.accelerometers.negative_pulses[1] == 4000000);
    CHECK(sample.interval_ns == 5000000);

    /* What is refused changes nothing, and the message names it. */
    unchanged = sample;
    force[1] = NAN;
    GIVES(isotherm_fill(acquisition, &sample, force, NULL), ISOTHERM_ERROR_VALUE, "A2: the reading is NaN");
    force[1] = 0.0;
    rate[2] = 430.0;
    GIVES(isotherm_fill(acquisition, &sample, force, rate), ISOTHERM_ERROR_VALUE, "G3: the reading 430");
    CHECK(memcmp(&sample, &unchanged, sizeof sample) == 0);
    CHECK(isotherm_fill(acquisition, &sample, force, NULL) == ISOTHERM_OK);
    CHECK(sample.gyroscopes.positive_pulses[0] == 0 && isnan(sample.gyroscopes.head_temperature[2]));
    CHECK(isotherm_acquisition_close(acquisition) == ISOTHERM_OK);

    /* Without a resolution there are no readings, and another one than the table's is refused. */
    CHECK(isotherm_acquisition_connect(words[1], NULL, &acquisition) == ISOTHERM_OK);
    GIVES(isotherm_fill(acquisition, &sample, force, NULL), ISOTHERM_ERROR_VALUE, "resolution");
    CHECK(isotherm_acquisition_close(acquisition) == ISOTHERM_OK);
    options.accelerometer_resolution = 1e-5;
    GIVES(isotherm_acquisition_connect(words[1], &options, &acquisition), ISOTHERM_ERROR_VALUE, "A1");

    isotherm_compensated_increment increment = {.interval_ns = 500000000, .velocity_increment = {1.0, NAN, -1.0}, .angle_increment = {0.5}};
    CHECK(isotherm_increment_specific_force(NULL, mean) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_increment_angular_rate(&increment, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_increment_specific_force(&increment, mean) == ISOTHERM_OK && mean[0] == 2.0 && isnan(mean[1]) && mean[2] == -2.0);
    CHECK(isotherm_increment_angular_rate(&increment, mean) == ISOTHERM_OK && mean[0] == 1.0 && mean[1] == 0.0);
    increment.interval_ns = 0;
    CHECK(isotherm_increment_specific_force(&increment, mean) == ISOTHERM_OK && isnan(mean[0]));
    return 0;
}
