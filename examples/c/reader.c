/*
 * A reader, such as navigation or a logger: prints the increments of an IMU as they are published, next to its acquisition.
 *
 *     reader IMU [COUNT]
 *
 * It may be started before the service. It continues when the service or the acquisition is restarted. When no increment comes for a
 * second, it says whether the service lives.
 */
#include <inttypes.h>
#include <isotherm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **words)
{
    if (count != 2 && count != 3) {
        fprintf(stderr, "usage: %s IMU [COUNT]\n", words[0]);
        return 64;
    }
    unsigned long long left = count == 3 ? strtoull(words[2], NULL, 10) : UINT64_MAX;
    isotherm_reader *reader;
    isotherm_code code = isotherm_reader_new(words[1], NULL, &reader);
    while (code >= 0 && left > 0) {
        isotherm_compensated_increment increment;
        code = isotherm_reader_receive_timeout(reader, 1000000000, &increment);
        if (code == ISOTHERM_OK) {
            /* Holes in the sequence are those of a reader that was too slow, too; between sessions time may be missing. */
            int64_t lost = isotherm_reader_lost_before(reader);
            if (lost > 0 || (increment.flags & ISOTHERM_MASK_LOST) != 0)
                fprintf(stderr, "%" PRIu64 ": %" PRId64 " control periods are missing before this increment (-1: unknown)\n",
                        increment.sequence, lost);
            const double *dv = increment.velocity_increment, *da = increment.angle_increment;
            printf("%" PRIu64 ",%.17g,%.17g,%.17g", increment.sequence, dv[0], dv[1], dv[2]);
            /* Without gyroscopes in the table, every angle is NaN. */
            if (!(isnan(da[0]) && isnan(da[1]) && isnan(da[2])))
                printf(",%.17g,%.17g,%.17g", da[0], da[1], da[2]);
            putchar('\n');
            fflush(stdout);
            left--;
        }
        uint64_t age_ns;
        if (code == ISOTHERM_NONE && isotherm_reader_heartbeat_age(reader, &age_ns) == ISOTHERM_OK)
            fprintf(stderr, "no increment for 1 s; the service was at work %.1f s ago\n", (double)age_ns / 1e9);
    }
    if (code < 0)
        fprintf(stderr, "reader: %s\n", isotherm_error_message());
    isotherm_reader_close(reader);
    return code < 0 ? 1 : 0;
}
