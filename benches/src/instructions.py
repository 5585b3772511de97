"""The acquisition of the bench `instructions` in Python: sends samples one by one, and receives each answer when it is certainly there."""

import sys
import time

import isotherm

imu, count = sys.argv[1], int(sys.argv[2])
with isotherm.Acquisition(imu, timeout=20.0) as acquisition, isotherm.IncrementReader(imu, timeout=20.0) as reader:
    for _ in range(count):
        sample = acquisition.loan()
        sample.interval_ns, sample.lag_ns = 2_500_000, 240_000_000_000
        for triad in sample.accelerometers, sample.gyroscopes:
            triad.positive_pulses = (140, 0, 150)
            triad.head_temperature = triad.board_temperature = triad.head_lagged = (2.4, 2.4, 2.4)
        acquisition.send(sample)
        # When the reader has it, the service has sent it, or is just sending it, to all.
        assert reader.receive(timeout=20.0) is not None
        time.sleep(0.001)
        while acquisition.receive() is None:
            time.sleep(0.001)
