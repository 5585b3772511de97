"""An acquisition process: sends raw samples, gets increments. Run it beside `isotherm serve --imu imu-a=tests/data/imu-a.toml`."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import isotherm


@dataclass
class Latched:
    """The values that the hardware latches at the end of an interval."""

    timestamp_ns: int
    positive: tuple[int, int, int]
    negative: tuple[int, int, int]
    head: tuple[float, float, float]
    board: tuple[float, float, float]


def hardware(count: int) -> Iterator[Latched]:
    """Replace this by your hardware. Here: an IMU at rest."""
    for number in range(1, count + 1):
        yield Latched(number * 2_500_000, (140, 0, 150), (0, 110, 0), (2.5, 2.5, 2.5), (2.5, 2.5, 2.5))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--count", type=int, default=400)
    options = arguments.parse_args()
    velocity = [0.0, 0.0, 0.0]
    # Waits up to 5 s for the service, in the domain that ISOTHERM_DOMAIN names.
    with isotherm.Acquisition(options.imu) as acquisition:
        for latched in hardware(options.count):
            sample = acquisition.loan()  # a sample in shared memory
            sample.timestamp_ns = latched.timestamp_ns  # end of the period, your clock
            sample.interval_ns = 2_500_000  # the measured gate length
            sample.positive_pulses = latched.positive
            sample.negative_pulses = latched.negative
            sample.head_temperature = latched.head  # in the table's unit
            sample.board_temperature = latched.board
            try:
                increment = acquisition.compensate(sample, timeout=1.0)
            except isotherm.Timeout:
                print("the service does not answer; the sample is sent again when it is back")
                continue
            velocity = [v + dv for v, dv in zip(velocity, increment.velocity_increment, strict=True)]
            if increment.flags:
                print(increment.sequence, isotherm.flag_names(increment.flags))
    print(f"{options.count} samples, velocity {velocity} m/s")


if __name__ == "__main__":
    main()
