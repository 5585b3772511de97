"""An acquisition at the pace of its hardware: 400 readings a second, each sent when its control period ends.

    python paced.py [--imu imu-mems] [--periods N] [--core N --priority N]

Start with this program. It loses no control period while the service is away or replaced, and says so where one is lost all the same. Replace
`read_imu` by your hardware, and `navigate` by your navigation. The resolution is that of the table, here of
examples/tables/imu-mems.toml. An IMU that counts pulses writes them, and the measured gate length, into the sample itself. Core and priority
(SCHED_FIFO, 1 to 99) are for a machine that has a core to spare; they need rights, see docs/operate.md. The environment variable
ISOTHERM_DOMAIN names the domain.
"""

import argparse
import gc
import os
import sys
import time

import isotherm
import numpy as np

PERIOD_NS = 2_500_000
TIMEOUT_S = 0.001  # an increment that takes longer is late; it leaves time for the rest of the period
TEMPERATURE_PERIODS = 40  # temperature is measured ten times a second
PREPARE_NS = 200_000  # how long before the end of a period its way is warmed
Vector = tuple[float, float, float]


def sleep_until(time_ns: int) -> None:
    time.sleep(max(0, time_ns - time.monotonic_ns()) / 1e9)


def read_imu(period: int) -> tuple[Vector, Vector, float]:
    """Specific force [m/s2] and angular rate [rad/s], the means over the period, and temperature [degC]."""
    turn = period % 100
    return (0.1 + 1e-4 * turn, -0.3, 9.80665), (0.01, 1e-5 * turn - 0.02, 7.292e-5), 31.25 + 1e-6 * period


class Paced:
    def __init__(self, acquisition: isotherm.Acquisition) -> None:
        self.acquisition = acquisition
        self.temperature, self.measured_ns = 0.0, 0
        self.increments = 0
        self.velocity, self.angle = np.zeros(3), np.zeros(3)

    def run(self, periods: int) -> None:
        began = time.monotonic_ns()
        for period in range(periods):
            end = began + (period + 1) * PERIOD_NS
            sleep_until(end - PREPARE_NS)
            if time.monotonic_ns() < end:
                self.acquisition.prepare()
            sleep_until(end)
            sample = self.acquisition.loan()
            try:
                self.latch(sample, period, end)
            except ValueError as error:
                print(error, file=sys.stderr)  # the sample is dropped, a gap for every reader
                continue
            # While the service has no room, or is away, the sample waits, and a later call sends it.
            self.navigate(self.acquisition.exchange(sample, timeout=TIMEOUT_S))
        for _ in range(20):  # the last periods: wait for a service that is away, 20 s
            while (late := self.acquisition.receive(timeout=1.0)) is not None:
                self.navigate(late.to_numpy().reshape(1))
            if self.acquisition.kept == 0 and self.acquisition.in_flight == 0:
                break

    def latch(self, sample: isotherm.Loan, period: int, end: int) -> None:
        """What the hardware has measured. Temperature that is not set is NaN, every other field 0."""
        specific_force, angular_rate, temperature = read_imu(period)
        if period % TEMPERATURE_PERIODS == 0:  # a new measurement; a value that is only repeated is not given again
            self.temperature, self.measured_ns = temperature, end
            self.acquisition.reading_of_all(temperature, end)
        sample.timestamp_ns, sample.interval_ns = end, PERIOD_NS
        sample.telemetry_ns = self.measured_ns
        self.acquisition.fill(sample, specific_force, angular_rate)
        for triad in (sample.accelerometers, sample.gyroscopes):
            triad.head_temperature = triad.board_temperature = (self.temperature,) * 3

    def navigate(self, increments: isotherm.Records) -> None:
        """A value counts if it is finite, whatever the flags say."""
        for increment in increments:
            sequence, flags = int(increment["sequence"]), int(increment["flags"])
            if flags & isotherm.Flags.LOST:
                print(f"{sequence}: time is missing before this increment", flush=True)
            if flags & (isotherm.Flags.INVALID | isotherm.Flags.DEGRADED):
                print(sequence, isotherm.flag_names(flags), flush=True)
            self.velocity += np.nan_to_num(increment["velocity_increment"])
            self.angle += np.nan_to_num(increment["angle_increment"])
            self.increments += 1


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--imu", default="imu-mems")
    arguments.add_argument("--periods", type=int, default=4000)
    arguments.add_argument("--core", type=int)
    arguments.add_argument("--priority", type=int)
    options = arguments.parse_args()
    if options.core is not None:
        os.sched_setaffinity(0, {options.core})
    if options.priority is not None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(options.priority))
    gc.disable()  # nothing here makes cycles, and a collection takes milliseconds
    with isotherm.Acquisition(options.imu, serial=os.environ.get("SERIAL"), resolution=(1e-6, 1e-7)) as acquisition:
        paced = Paced(acquisition)
        paced.run(options.periods)
        lost, _ = acquisition.close()
    print(f"{options.periods} periods: {paced.increments} increments, {lost} lost")
    print("velocity", *(f"{value:.9f}" for value in paced.velocity), "m/s")
    print("angle", *(f"{value:.9f}" for value in paced.angle), "rad")


if __name__ == "__main__":
    main()
