"""An acquisition process: sends raw samples, gets increments. Run it next to `isotherm serve --imu imu-a=tests/data/imu-a.toml`."""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import isotherm


@dataclass
class Latched:
    """The values that the hardware latches at the end of an interval."""

    timestamp_ns: int
    positive: tuple[int, int, int]
    negative: tuple[int, int, int]
    head: tuple[float, float, float]
    board: tuple[float, float, float]
    telemetry_ns: int
    """When the temperatures were measured. In most intervals they are only repeated."""


def hardware(count: int) -> Iterator[Latched]:
    """Replace this by your hardware. Here: an IMU at rest, whose temperatures are measured in every 40th interval.

    Its clock goes on when this process ends. Otherwise its successor could not go on with the lag.
    """
    measured_ns = 0
    for number in range(count):
        now_ns = time.monotonic_ns()
        if number % 40 == 0:
            measured_ns = now_ns
        yield Latched(now_ns, (140, 0, 150), (0, 110, 0), (2.5, 2.5, 2.5), (2.5, 2.5, 2.5), measured_ns)


def restore(acquisition: isotherm.Acquisition, state: Path | None, unknown: bool) -> None:
    """Goes on with the lag of the temperatures that a predecessor of this process has kept.

    Without one the IMU is taken to be soaked, if nothing else is said.
    """
    if state is None or (not state.exists() and not unknown):
        acquisition.soaked()
        return
    try:
        acquisition.restore_lag(json.loads(state.read_text()))
    except (OSError, ValueError, TypeError) as error:
        print(f"{state}: no state of the lag; flagged lag-unknown for three time constants: {error}")
        acquisition.forget_lag()


def save(acquisition: isotherm.Acquisition, state: Path | None) -> None:
    """Keeps the lag in a file that is complete whenever this process ends."""
    if state is not None:
        staged = state.with_name(state.name + ".new")
        staged.write_text(json.dumps(acquisition.lag_state()))
        staged.rename(state)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--serial", help="serial number of the device; the service flags samples of another one than the table's")
    arguments.add_argument("--state", type=Path, help="file that keeps the lag of the temperatures for a restart")
    arguments.add_argument("--unknown", action="store_true", help="without that file, flag increments until the lag is known")
    arguments.add_argument("--count", type=int, default=400)
    options = arguments.parse_args()
    velocity, measured_ns = [0.0, 0.0, 0.0], 0
    # Waits up to 5 s for the service, in the domain that ISOTHERM_DOMAIN names.
    with isotherm.Acquisition(options.imu, serial=options.serial) as acquisition:
        restore(acquisition, options.state, options.unknown)
        for latched in hardware(options.count):
            if latched.telemetry_ns != measured_ns:  # new temperatures; a gyroscope's are read as "G1" to "G3"
                measured_ns = latched.telemetry_ns
                for name, head in zip(("A1", "A2", "A3"), latched.head, strict=True):
                    acquisition.reading(name, head, measured_ns)
                save(acquisition, options.state)
            sample = acquisition.loan()  # a sample in shared memory
            sample.timestamp_ns = latched.timestamp_ns  # end of the period, your clock
            sample.telemetry_ns = measured_ns
            sample.interval_ns = 2_500_000  # the measured gate length
            triad = sample.accelerometers  # and sample.gyroscopes, where the IMU has them
            triad.positive_pulses = latched.positive
            triad.negative_pulses = latched.negative
            triad.head_temperature = latched.head  # in the table's unit
            triad.board_temperature = latched.board
            try:
                increment = acquisition.compensate(sample, timeout=1.0)
            except isotherm.Timeout:
                print("the service does not answer; the sample is sent again when it is back")
                continue
            for increment in (increment, *iter(acquisition.receive, None)):  # and those that came late
                velocity = [v + dv for v, dv in zip(velocity, increment.velocity_increment, strict=True)]
                if increment.flags & ~isotherm.Flags.INFORMATION:
                    print(increment.sequence, isotherm.flag_names(increment.flags))
    print(f"{options.count} samples, velocity {velocity} m/s")


if __name__ == "__main__":
    main()
