"""What a made-up driver publishes: one message a period, with the faults that a test asks for."""

import time


def add_arguments(parser):
    numbers = {"type": lambda text: [int(number) for number in text.split(",")], "default": []}
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--skip", help="periods that are lost", **numbers)
    parser.add_argument("--double", help="periods that come twice", **numbers)
    parser.add_argument("--nan", help="periods whose force is not a number", **numbers)
    parser.add_argument("--foreign", help="periods of another frame", **numbers)
    parser.add_argument("--absurd", help="periods with a stamp of 1970", **numbers)
    parser.add_argument("--now", action="store_true", help="stamps are when it publishes, not when it should")
    parser.add_argument("--behind", type=float, default=0.0, help="by how much the driver's clock is behind, in s")


def message(period):
    """The readings of a period."""
    return {
        "force": [1e-3 * (period % 1000), -2e-3 * (period % 700), 9.8],
        "rate": [1e-4 * (period % 500), 0.5, -1e-4 * (period % 300)],
        "frame": "imu_link",
    }


def drive(arguments, publish):
    """Publishes at the rate, each message when it is due."""
    interval_ns = round(1e9 / arguments.rate)
    begin = time.monotonic_ns()
    unix_ns = time.time_ns() - round(arguments.behind * 1e9)
    for period in range(arguments.count):
        due = begin + period * interval_ns
        while time.monotonic_ns() < due:
            time.sleep(max(0.0, (due - time.monotonic_ns()) / 1e9))
        found = message(period) | {"stamp_ns": unix_ns + period * interval_ns}
        if arguments.now:
            found["stamp_ns"] = time.time_ns()
        if period in arguments.nan:
            found["force"] = [float("nan")] * 3
        if period in arguments.foreign:
            found["frame"] = "camera"
        if period in arguments.absurd:
            found["stamp_ns"] = 5
        if period not in arguments.skip:
            publish(found)
        if period in arguments.double:
            publish(found)
