"""The acquisition in Python of the bench `languages`. The header of bin/languages.rs describes the protocol."""

import array
import sys
import time

import isotherm


def round_trips(acquisition, count):
    """The duration of each round trip, in nanoseconds."""
    now, loan, compensate = time.monotonic_ns, acquisition.loan, acquisition.compensate
    times = array.array("Q", bytes(8 * count))
    for index in range(count):
        sent = now()
        sample = loan()
        sample.interval_ns = 2_500_000
        for triad, positive, negative in (
            (sample.accelerometers, (140, 0, 150), (0, 110, 0)),
            (sample.gyroscopes, (20, 0, 3), (0, 17, 4)),
        ):
            triad.positive_pulses = positive
            triad.negative_pulses = negative
            triad.head_temperature = (2.4, 2.41, 2.42)
            triad.board_temperature = (2.5, 2.51, 2.52)
        compensate(sample, 5.0)
        times[index] = now() - sent
    return times


def main():
    imu, domain = sys.argv[2], sys.argv[4]
    with isotherm.Acquisition(imu, domain=domain, timeout=5.0) as acquisition:
        print("ready", flush=True)
        for line in sys.stdin:
            sys.stdout.buffer.write(round_trips(acquisition, int(line.split()[1])).tobytes())
            sys.stdout.flush()


main()
