"""A reader, as navigation and loggers are: prints increments as they come, once a second what has come."""

import argparse
import time

import isotherm


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--count", type=int, default=100, help="increments to read before it ends")
    options = arguments.parse_args()
    # The reader may be started before the service: with timeout=None it connects as soon as the service runs.
    with isotherm.IncrementReader(options.imu, timeout=None) as reader:
        while not reader.connected:
            reader.receive(timeout=0.1)
        print("connected", flush=True)
        # Read one increment, as soon as it arrives.
        first = next(reader)
        print(f"first: sequence {first.sequence}, {first.velocity_increment} m/s, {first.angle_increment} rad", flush=True)
        # Or read all increments that have arrived, as one array.
        count = 1
        while count < options.count:
            increments = reader.read_available()
            count += len(increments)
            if len(increments):
                dv = increments["velocity_increment"].sum(axis=0)
                lost = int(((increments["flags"] & isotherm.Flags.LOST) != 0).sum())
                print(f"{len(increments)} increments, sum {dv} m/s, time lost before {lost}", flush=True)
            time.sleep(0.05)
    print(f"{count} increments")


if __name__ == "__main__":
    main()
