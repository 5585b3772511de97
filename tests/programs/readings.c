/*
 * Turns readings into pulses and increments into readings, rightly and wrongly. Exits with 0 if all is as documented. It needs no service.
 */
#include <isotherm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

int main(void)
{
    const isotherm_readings initial = {.accelerometer = 1e-6, .gyroscope = 1e-7, .interval_ns = 2500000};
    isotherm_readings readings = initial, before;
    isotherm_raw_sample sample = ISOTHERM_RAW_SAMPLE_INIT, unchanged;
    double force[3] = {1.0000003, -2.0, 0.0}, rate[3] = {0.5, 0.0, -0.5}, mean[3];
    CHECK(isotherm_readings_fill(NULL, &sample, force, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_readings_fill(&readings, NULL, force, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_readings_fill(&readings, &sample, NULL, rate) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_readings_fill(&readings, &sample, force, rate) == ISOTHERM_OK && sample.interval_ns == 2500000);
    CHECK(sample.accelerometers.positive_pulses[0] == 1000000 && sample.accelerometers.negative_pulses[1] == 2000000);
    CHECK(sample.gyroscopes.positive_pulses[0] == 5000000 && sample.gyroscopes.negative_pulses[2] == 5000000);
    CHECK(fabs(readings.remainders[0] - 0.3) < 1e-6);

    /* What is refused changes nothing, and the message names it. */
    before = readings;
    unchanged = sample;
    force[1] = NAN;
    GIVES(isotherm_readings_fill(&readings, &sample, force, NULL), ISOTHERM_ERROR_VALUE, "A2: the reading is NaN");
    force[1] = 0.0;
    rate[2] = 430.0;
    GIVES(isotherm_readings_fill(&readings, &sample, force, rate), ISOTHERM_ERROR_VALUE, "G3: the reading 430");
    CHECK(memcmp(&readings, &before, sizeof before) == 0 && memcmp(&sample, &unchanged, sizeof sample) == 0);
    readings.accelerometer = 0.0;
    GIVES(isotherm_readings_fill(&readings, &sample, force, NULL), ISOTHERM_ERROR_VALUE, "the resolution is 0");
    readings = initial;
    readings.interval_ns = 0;
    GIVES(isotherm_readings_fill(&readings, &sample, force, NULL), ISOTHERM_ERROR_VALUE, "the interval is 0 ns");
    readings = initial;
    memset(readings.remainders, 0xff, sizeof readings.remainders); /* NaN */
    CHECK(isotherm_readings_fill(&readings, &sample, force, NULL) == ISOTHERM_OK && fabs(readings.remainders[0] - 0.3) < 1e-6);
    CHECK(sample.gyroscopes.positive_pulses[0] == 0 && isnan(sample.gyroscopes.head_temperature[2]));

    isotherm_compensated_increment increment = {.interval_ns = 500000000, .velocity_increment = {1.0, NAN, -1.0}, .angle_increment = {0.5}};
    CHECK(isotherm_increment_specific_force(NULL, mean) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_increment_angular_rate(&increment, NULL) == ISOTHERM_ERROR_NULL);
    CHECK(isotherm_increment_specific_force(&increment, mean) == ISOTHERM_OK && mean[0] == 2.0 && isnan(mean[1]) && mean[2] == -2.0);
    CHECK(isotherm_increment_angular_rate(&increment, mean) == ISOTHERM_OK && mean[0] == 1.0 && mean[1] == 0.0);
    increment.interval_ns = 0;
    CHECK(isotherm_increment_specific_force(&increment, mean) == ISOTHERM_OK && isnan(mean[0]));
    return 0;
}
