"""An acquisition at the pace of its hardware: 400 samples a second, each sent when its control period ends.

    python paced.py --imu imu-a [--periods N] [--core N --priority N]

Start with this program. It loses no control period while the service is replaced, and says so where one is lost all the same. Replace `latch`
by your hardware, and `navigate` by your navigation. Core and priority (SCHED_FIFO, 1 to 99) are for a machine that has a core to spare; they
need rights, see docs/operate.md. The environment variable ISOTHERM_DOMAIN names the domain.
"""

import argparse
import gc
import math
import os
import time

import isotherm

PERIOD_NS = 2_500_000
TIMEOUT_S = 0.001  # an increment that takes longer is late; it leaves time for the rest of the period
TELEMETRY_PERIODS = 40  # telemetry is measured ten times a second
PREPARE_NS = 200_000  # how long before the end of a period its way is warmed


def sleep_until(time_ns: int) -> None:
    time.sleep(max(0, time_ns - time.monotonic_ns()) / 1e9)


class Paced:
    def __init__(self, acquisition: isotherm.Acquisition) -> None:
        self.acquisition = acquisition
        self.waiting: isotherm.Loan | None = None  # a sample for which there was no room; the next periods are added to it
        self.head, self.measured_ns = 0.0, 0
        self.answered = self.late = self.merged = 0
        self.velocity = [0.0, 0.0, 0.0]

    def run(self, periods: int) -> None:
        began = time.monotonic_ns()
        for period in range(periods):
            end = began + (period + 1) * PERIOD_NS
            sleep_until(end - PREPARE_NS)
            if time.monotonic_ns() < end:
                self.acquisition.prepare()
            sleep_until(end)
            self.add(self.latch(period, end))
            self.exchange()
        for _ in range(20_000):  # the last periods: wait for a service that is away, 20 s
            if self.waiting is None and self.acquisition.in_flight == 0:
                break
            self.exchange()
            time.sleep(0.001)

    def latch(self, period: int, end: int) -> isotherm.Loan:
        """What the hardware has counted and measured. Every field that is not set is 0."""
        if period % TELEMETRY_PERIODS == 0:  # a new measurement; a value that is only repeated is not given again
            self.head, self.measured_ns = 2.5 + 1e-6 * period, end
            for name in ("A1", "A2", "A3"):
                self.acquisition.reading(name, self.head, self.measured_ns)
        sample = self.acquisition.loan()
        sample.timestamp_ns = end
        sample.interval_ns = PERIOD_NS  # the measured gate length
        sample.telemetry_ns = self.measured_ns
        sample.accelerometers.positive_pulses = (140, 141, 142)
        sample.accelerometers.head_temperature = (self.head,) * 3
        sample.accelerometers.board_temperature = (self.head,) * 3
        return sample

    def add(self, sample: isotherm.Loan) -> None:
        """Adds a period to the one that waits, or gives up the one that waits."""
        if self.waiting is None:
            self.waiting = sample
            return
        try:
            self.waiting.merge(sample)
            self.merged += 1
        except OverflowError:  # over an hour without a service: the sample that waits is dropped, a gap for every reader
            self.waiting = sample

    def exchange(self) -> None:
        """Sends what waits and takes all increments that are there. A full queue leaves the sample to the next period."""
        if self.waiting is not None:
            try:
                increment = self.acquisition.compensate(self.waiting, timeout=TIMEOUT_S)
                self.waiting = None
                self.answered += 1
                self.navigate(increment)
            except isotherm.Timeout:
                self.waiting = None  # it was sent; its increment comes from `receive`
            except isotherm.Full:
                pass
        while (late := self.acquisition.receive()) is not None:
            self.late += 1
            self.navigate(late)

    def navigate(self, increment: isotherm.Increment) -> None:
        """A value counts if it is finite, whatever the flags say."""
        if increment.flags & isotherm.Flags.LOST:
            print(f"{increment.sequence}: time is missing before this increment", flush=True)
        if increment.flags & (isotherm.Flags.INVALID | isotherm.Flags.DEGRADED):
            print(increment.sequence, isotherm.flag_names(increment.flags), flush=True)
        for axis, dv in enumerate(increment.velocity_increment):
            if math.isfinite(dv):
                self.velocity[axis] += dv


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--periods", type=int, default=4000)
    arguments.add_argument("--core", type=int)
    arguments.add_argument("--priority", type=int)
    options = arguments.parse_args()
    if options.core is not None:
        os.sched_setaffinity(0, {options.core})
    if options.priority is not None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(options.priority))
    gc.disable()  # nothing here makes cycles, and a collection takes milliseconds
    with isotherm.Acquisition(options.imu, serial=os.environ.get("SERIAL")) as acquisition:
        paced = Paced(acquisition)
        paced.run(options.periods)
        lost, _ = acquisition.close()
    print(f"{options.periods} periods: {paced.answered} answered in time, {paced.late} late, {paced.merged} merged, {lost} lost")
    print("velocity", *(f"{value:.9g}" for value in paced.velocity), "m/s")


if __name__ == "__main__":
    main()
