"""An acquisition whose IMU delivers readings, as every MEMS does: m/s2 and rad/s become a sample, and its increment becomes m/s2 and rad/s
again, compensated.

    python mems.py [--imu imu-mems] [--samples N]

Replace `read_imu` by your driver. The resolution is that of the table, here of examples/tables/imu-mems.toml; the interval is your own. The pace of an IMU,
and what to do when the service is away: paced.py. The environment variable ISOTHERM_DOMAIN names the domain.
"""

import argparse
import sys

import isotherm

INTERVAL_NS = 2_500_000
Vector = tuple[float, float, float]


def read_imu(sample: int) -> tuple[Vector, Vector, float]:
    """Specific force [m/s2], angular rate [rad/s] and temperature [degC]."""
    turn = sample / 7.0
    return (0.1234567, -0.2345678 - turn, 9.8012345), (0.01234567, -turn, 0.00001234), 31.25


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--imu", default="imu-mems")
    arguments.add_argument("--samples", type=int, default=8)
    options = arguments.parse_args()
    with isotherm.Acquisition(options.imu, resolution=(1e-6, 1e-7)) as acquisition:
        for number in range(options.samples):
            specific_force, angular_rate, temperature = read_imu(number)
            sample = acquisition.loan()
            sample.timestamp_ns, sample.interval_ns = (number + 1) * INTERVAL_NS, INTERVAL_NS
            try:
                acquisition.fill(sample, specific_force, angular_rate)
            except ValueError as error:
                print(error, file=sys.stderr)  # the sample is left out, a gap for every reader
                continue
            for triad in (sample.accelerometers, sample.gyroscopes):
                triad.head_temperature = triad.board_temperature = (temperature,) * 3
            increment = acquisition.compensate(sample, timeout=20.0)
            force, rate = increment.specific_force, increment.angular_rate
            print(f"{increment.sequence}:", *(f"{value:.9f}" for value in force), "m/s2,", *(f"{value:.9f}" for value in rate), "rad/s")


if __name__ == "__main__":
    main()
