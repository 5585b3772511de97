"""Latency and processor time of the node of ROS 2, beside a bare pair of ros2-client and rclpy to rclpy, in turn.

    ISOTHERM_BUILT=target/release target/ros2/kilted/bin/python ros2/bench/latency.py [--rates 400,2000] [--seconds 5]

The folder has isotherm, isotherm-ros2 and examples/bare. Latencies are in us: from the stamp of a message, when its
driver published it, to the callback of the last subscriber; and from publishing the message that it gets.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from conftest import BUILT, ROOT, World  # noqa: E402

TABLE = ROOT / "examples/tables/imu-mems.toml"
NODE = """format = 1
[[publish]]
imu = "imu-mems"
[[subscribe]]
imu = "imu-mems"
topic = "/driver/imu/data_raw"
temperature_c = 25.0
gyroscope_resolution = 1e-7
interval_s = {interval}
reliability = "reliable"
depth = 2000
"""


def percentiles(values):
    values = sorted(values)
    return [values[int(len(values) * part)] for part in (0.5, 0.99)]


def processor_s(pid):
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def shown(what, rate, found, cpu=""):
    for key, values in found.items():
        p50, p99 = percentiles(values)
        print(f"{rate:6} Hz  {what:44} {key:16} p50 {p50:8.0f}  p99 {p99:8.0f} us  {cpu}", flush=True)


def latencies(subscriber):
    subscriber.wait_until(lambda: any("_us" in line for line in subscriber.lines), "the latencies")
    return subscriber.messages()[-1]


def with_world(run):
    with tempfile.TemporaryDirectory(prefix="iso-") as folder:
        world = World(Path(folder))
        try:
            run(world)
        finally:
            world.close()


def direct(rate, count):
    def run(world):
        subscriber = world.peer("fastdds", "subscribe", "/driver/imu/data_raw", "Imu", "--latencies", str(count - rate))
        subscriber.wait_for("ready")
        world.peer("fastdds", "drive", "/driver/imu/data_raw", "Imu", "--now", "--rate", str(rate), "--count", str(count))
        shown("rclpy to rclpy", rate, latencies(subscriber))

    with_world(run)


def through(rate, count):
    def run(world):
        table = TABLE.read_text().replace("nominal_interval_s = 0.0025", f"nominal_interval_s = {1 / rate}")
        service = world.serve("--imu", f"imu-mems={world.write('imu-mems.toml', table)}")
        node = world.node(world.write("node.toml", NODE.format(interval=1 / rate)))
        node.wait_for("connected to the service")
        # The first samples wait until the rate is known.
        some, after = count - 2 * rate, rate
        wanted = ["--latencies", str(some), "--after", str(after)]
        subscriber = world.peer("fastdds", "subscribe", "/imu_mems/imu/data_raw", "Imu", *wanted)
        node.wait_for("/imu_mems/imu/data_raw: 1 subscribers")
        driver = world.peer("fastdds", "drive", "/driver/imu/data_raw", "Imu", "--now", "--rate", str(rate), "--count", str(count))
        driver.wait_for("matched")
        before = [processor_s(running.process.pid) for running in (node, service)]
        driver.wait_for("driven")
        after = [processor_s(running.process.pid) for running in (node, service)]
        parts = [100 * (b - a) / (count / rate) for a, b in zip(before, after)]
        cpu = f"node {parts[0]:.0f} %, service {parts[1]:.0f} % of a core"
        shown("rclpy to node, service, node to rclpy", rate, latencies(subscriber), cpu)

    with_world(run)


def bare(rate, count):
    def run(world):
        program = BUILT / "examples/bare"
        subscriber = world.start([program, "subscribe", str(count - rate)])
        subscriber.wait_for("ready")
        publisher = world.start([program, "publish", str(rate), str(count)])
        publisher.wait_for("matched")
        shown("ros2-client to ros2-client", rate, latencies(subscriber))

    with_world(run)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", default="400,2000")
    parser.add_argument("--seconds", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=2)
    arguments = parser.parse_args()
    for _ in range(arguments.rounds):
        for rate in map(int, arguments.rates.split(",")):
            for part in (bare, direct, through):
                part(rate, rate * arguments.seconds)


if __name__ == "__main__":
    main()
