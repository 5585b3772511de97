"""Measures round trips next to `isotherm serve`: from Python, and in one call whose loop is in Rust, in alternating blocks of one run."""

import argparse
import gc
import time
from collections.abc import Callable

import numpy as np

import isotherm

BLOCK = 1000
PULSES = (140, 0, 150)
TEMPERATURE = (2.5, 2.5, 2.5)


def timed(work: Callable[[int], object]) -> list[int]:
    """The durations of the calls of a block [ns]."""
    clock, times = time.perf_counter_ns, []
    for number in range(BLOCK):
        begun = clock()
        work(number)
        times.append(clock() - begun)
    return times


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--blocks", type=int, default=20, help=f"of {BLOCK} samples")
    options = arguments.parse_args()
    samples = np.zeros(BLOCK, isotherm.RAW_SAMPLE)
    samples["sequence"] = np.arange(BLOCK)
    samples["interval_ns"] = 2_500_000
    for triad in ("accelerometers", "gyroscopes"):
        samples[triad]["positive_pulses"] = PULSES
        samples[triad]["head_temperature"] = samples[triad]["board_temperature"] = TEMPERATURE
    names = ("compensate(loan), filled in before", "loan, fill in, compensate", "compensate(record)", "the timer itself")
    found: dict[str, list[int]] = {name: [] for name in names}
    means: dict[str, list[float]] = {"run(window=1)": [], "run()": []}
    with isotherm.Acquisition(options.imu) as acquisition:

        def filled(number: int) -> isotherm.Loan:
            loan = acquisition.loan()
            loan.timestamp_ns = number
            loan.interval_ns = 2_500_000
            for triad in (loan.accelerometers, loan.gyroscopes):
                triad.positive_pulses = triad.negative_pulses = PULSES
                triad.head_temperature = triad.board_temperature = TEMPERATURE
            return loan

        gc.freeze()
        for _ in range(options.blocks):
            # Loan and fill in before the clock is read. Only 4 loans are allowed at once, so the calls are timed one by
            # one.
            for number in range(BLOCK):
                loan = filled(number)
                begun = time.perf_counter_ns()
                acquisition.compensate(loan)
                found[names[0]].append(time.perf_counter_ns() - begun)
            found[names[1]] += timed(lambda number: acquisition.compensate(filled(number)))
            records = list(samples)
            acquisition.begin_session()
            found[names[2]] += timed(lambda number: acquisition.compensate(records[number]))
            found[names[3]] += timed(lambda number: None)
            for name, window in (("run(window=1)", 1), ("run()", None)):
                begun = time.perf_counter_ns()
                acquisition.run(samples, window=window)
                means[name].append((time.perf_counter_ns() - begun) / BLOCK)
            acquisition.begin_session()
    print(f"{'[us]':36} {'p50':>8} {'p99':>8} {'p99.9':>8} {'max':>10}")
    for name, times in found.items():
        p50, p99, p999 = np.percentile(times, (50, 99, 99.9)) / 1000
        print(f"{name:36} {p50:8.2f} {p99:8.2f} {p999:8.2f} {max(times) / 1000:10.2f}")
    for name, mean in means.items():
        print(f"{name:36} {np.median(mean) / 1000:8.2f}  a sample, median of the blocks' means")


if __name__ == "__main__":
    main()
