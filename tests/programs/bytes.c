/*
 * Sends samples from stdin and writes their increments to stdout, both as the bytes of the structures: bytes IMU. It is valid C and C++.
 */
#include <isotherm.h>
#include <stdio.h>
#include <string.h>

int main(int count, char **words)
{
    isotherm_acquisition *acquisition;
    isotherm_raw_sample given, *sample;
    isotherm_compensated_increment increment;
    isotherm_options options;
    memset(&options, 0, sizeof options);
    options.timeout_ns = 20000000000u;
    if (count != 2 || isotherm_acquisition_connect(words[1], &options, &acquisition) != ISOTHERM_OK)
        return 1;
    while (fread(&given, sizeof given, 1, stdin) == 1) {
        if (isotherm_loan(acquisition, &sample) != ISOTHERM_OK)
            return 1;
        given.session = sample->session;
        *sample = given;
        if (isotherm_compensate(acquisition, sample, 20000000000u, &increment) != ISOTHERM_OK)
            return 1;
        fwrite(&increment, sizeof increment, 1, stdout);
    }
    return isotherm_acquisition_close(acquisition) != ISOTHERM_OK;
}
