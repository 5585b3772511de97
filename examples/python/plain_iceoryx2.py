"""A peer without the isotherm package: iceoryx2's own wheel, version 0.10.0 as the service has it, and ctypes."""

# pyright: reportAttributeAccessIssue=false
# The modules of iceoryx2 do not say which names they have.

import argparse
import ctypes
import hashlib
import json
import subprocess
import time

import iceoryx2 as iox2


class Triad(ctypes.Structure):
    """What three sensors of one kind have measured: 96 bytes."""

    _fields_ = [
        ("positive_pulses", ctypes.c_uint32 * 3),
        ("negative_pulses", ctypes.c_uint32 * 3),
        ("head_temperature", ctypes.c_double * 3),  # in the table's unit
        ("board_temperature", ctypes.c_double * 3),
        ("head_lagged", ctypes.c_double * 3),  # head_temperature behind its lag, see docs/temperature-in-motion.md; unused without lag_ns
    ]


class RawSample(ctypes.Structure):
    """256 bytes; the fields are described in docs/recordings.md and shared/src/wire.rs."""

    _fields_ = [
        ("session", ctypes.c_uint64),  # chosen at random each time that the acquisition starts
        ("sequence", ctypes.c_uint64),  # +1 each sample
        ("timestamp_ns", ctypes.c_uint64),  # end of the period, your clock
        ("interval_ns", ctypes.c_uint64),  # the measured gate length
        ("sent_ns", ctypes.c_uint64),  # CLOCK_MONOTONIC when it is sent; 0 = unknown
        ("telemetry_ns", ctypes.c_uint64),  # when the temperatures were read, your clock; 0 = unknown
        ("lag_ns", ctypes.c_uint64),  # time constant of head_lagged; 0 = there is none
        ("device", ctypes.c_uint64),  # which unit; 0 = unknown
        ("accelerometers", Triad),
        ("gyroscopes", Triad),  # where the IMU has none: temperature NaN
    ]

    @staticmethod
    def type_name() -> str:
        return "isotherm.RawSample.v2"


class CompensatedIncrement(ctypes.Structure):
    """104 bytes."""

    _fields_ = [
        ("session", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("timestamp_ns", ctypes.c_uint64),
        ("interval_ns", ctypes.c_uint64),
        ("velocity_increment", ctypes.c_double * 3),  # m/s; NaN where it could not be computed
        ("angle_increment", ctypes.c_double * 3),  # rad; NaN also where the table has no gyroscopes
        ("table", ctypes.c_uint64),  # first 8 bytes of the table's digest
        ("flags", ctypes.c_uint64),
        ("latency_ns", ctypes.c_uint64),
    ]

    @staticmethod
    def type_name() -> str:
        return "isotherm.CompensatedIncrement.v2"


def device(serial: str) -> int:
    """The number of the device with this serial number."""
    return int.from_bytes(hashlib.sha256(serial.strip().encode()).digest()[:8], "big") if serial.strip() else 0


def join(isotherm: str) -> iox2.Node:
    """A node in the domain of the running service; ISOTHERM_DOMAIN and ISOTHERM_ROOT name it, as for `isotherm status`."""
    status = subprocess.run([isotherm, "status", "--json"], check=True, capture_output=True, text=True)
    domain = json.loads(status.stdout)["domain"]
    config = iox2.config.default()
    config.global_cfg.prefix = iox2.FileName.new(domain["prefix"])
    config.global_cfg.root_path = iox2.Path.new(domain["root_path"])
    return iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--imu", default="imu-a")
    arguments.add_argument("--serial", default="", help="serial number of the device")
    arguments.add_argument("--count", type=int, default=10)
    arguments.add_argument("--isotherm", default="isotherm", help="the program, which shows where the domain is")
    options = arguments.parse_args()
    node = join(options.isotherm)

    def name(stream: str) -> iox2.ServiceName:
        return iox2.ServiceName.new(f"isotherm/{options.imu}/{stream}")

    # Only the service creates streams; everybody else opens them.
    increments = node.service_builder(name("increment")).publish_subscribe(CompensatedIncrement).open()
    subscriber = increments.subscriber_builder().create()
    raw = node.service_builder(name("raw")).publish_subscribe(RawSample).open()
    # One acquisition an IMU. A full queue must not block: the sample is dropped, and flagged as a gap.
    publisher = raw.publisher_builder().backpressure_strategy(iox2.BackpressureStrategy.DiscardData).create()
    notifier = node.service_builder(name("wake")).event().open().notifier_builder().create()

    session = time.time_ns()
    for sequence in range(options.count):
        sample = RawSample(session=session, sequence=sequence, timestamp_ns=(sequence + 1) * 2_500_000, interval_ns=2_500_000)
        sample.sent_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
        sample.device = device(options.serial)
        triad = sample.accelerometers
        triad.positive_pulses[:] = (140, 0, 150)
        triad.negative_pulses[:] = (0, 110, 0)
        triad.head_temperature[:] = triad.board_temperature[:] = (2.5, 2.5, 2.5)
        publisher.send_copy(sample)
        notifier.notify()  # wakes a service that sleeps
        deadline = time.monotonic() + 5.0
        while (answer := subscriber.receive()) is None and time.monotonic() < deadline:
            pass
        if answer is None:
            raise SystemExit(f"sample {sequence}: no answer in 5 s")
        increment = answer.payload().contents
        print(increment.sequence, *increment.velocity_increment, *increment.angle_increment, f"{increment.table:016x}", increment.flags)
        answer.delete()


if __name__ == "__main__":
    main()
