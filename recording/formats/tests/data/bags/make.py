"""Makes the bags of this folder: the same messages with each compression of MCAP. Run with mcap 1.6: python make.py"""

import struct
from pathlib import Path

from mcap.writer import CompressionType, Writer

MESSAGES = 60
STEP_NS = 5_000_000
BEGIN_NS = 1_700_000_000_000_000_000


def imu(number: int) -> bytes:
    """A sensor_msgs/msg/Imu in little-endian CDR."""
    seconds, nanoseconds = divmod(BEGIN_NS + number * STEP_NS, 1_000_000_000)
    frame = b"imu_link\0"
    head = struct.pack("<iII", seconds, nanoseconds, len(frame)) + frame
    head += bytes(-len(head) % 8)
    rate = [0.001 * (number % 7), -0.002, 0.0005 * (number % 3)]
    acceleration = [0.01 * (number % 5), -0.02, 9.8 + 0.001 * (number % 11)]
    values = [0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8, *rate, *[0.0] * 9, *acceleration, *[0.0] * 9]
    return b"\0\1\0\0" + head + struct.pack(f"<{len(values)}d", *values)


for compression in CompressionType:
    path = Path(__file__).with_name(f"{compression.name.lower()}.mcap")
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=8192, compression=compression)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        channel = writer.register_channel("/imu", "cdr", schema)
        for number in range(MESSAGES):
            time_ns = BEGIN_NS + number * STEP_NS
            writer.add_message(channel, time_ns, imu(number), time_ns, number)
        writer.finish()
