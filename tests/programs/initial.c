/*
 * Sends two samples without gyroscopes, a loan as it comes and a sample of its own, and writes their increments to stdout as the bytes
 * of the structures: initial IMU [TEMPERATURE]. It is valid C and C++.
 */
#include <isotherm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int main(int count, char **words)
{
    isotherm_acquisition *acquisition;
    isotherm_raw_sample own = ISOTHERM_RAW_SAMPLE_INIT, *sample;
    isotherm_compensated_increment increment;
    isotherm_options options;
    memset(&options, 0, sizeof options);
    options.timeout_ns = 20000000000u;
    if (count < 2 || isotherm_acquisition_connect(words[1], &options, &acquisition) != ISOTHERM_OK)
        return 1;
    for (unsigned sent = 0; sent < 2; sent++) {
        if (isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
            return 1;
        if (sent == 1) {
            own.session = sample->session;
            own.sequence = sample->sequence;
            *sample = own;
        }
        sample->timestamp_ns = (sent + 1) * 1000000u;
        sample->interval_ns = 1000000;
        for (int axis = 0; axis < 3 && count == 3; axis++)
            sample->accelerometers.head_temperature[axis] = sample->accelerometers.board_temperature[axis] = atof(words[2]);
        if (isotherm_compensate(acquisition, sample, 20000000000u, &increment) != ISOTHERM_OK)
            return 1;
        fwrite(&increment, sizeof increment, 1, stdout);
    }
    return isotherm_acquisition_close(acquisition) != ISOTHERM_OK;
}
