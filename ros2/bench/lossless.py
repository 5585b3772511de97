"""Whether every message comes: eight IMUs at 400 Hz and one at 2 kHz, published by one node into a reliable subscriber
that keeps up: one in Rust, since rclpy takes about 0.3 ms of a core for each message.

    ISOTHERM_BUILT=target/release target/ros2/kilted/bin/python ros2/bench/lossless.py [--seconds 120]

The folder has isotherm, isotherm-ros2 and examples/bare. Exits with 1 if a message is missing.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from conftest import BUILT, ROOT  # noqa: E402
from latency import processor_s, with_world  # noqa: E402

TABLE = ROOT / "tests/data/imu-a.toml"
IMUS = {f"imu-{number}": 400 for number in range(8)} | {"imu-fast": 2000}


def topic(imu):
    return f"/{imu.replace('-', '_')}/imu/data_raw"


def run(seconds):
    missing = []

    def within(world):
        tables = [world.write(f"{imu}.toml", TABLE.read_text().replace('id = "imu-a"', f'id = "{imu}"')) for imu in IMUS]
        served = [word for imu, table in zip(IMUS, tables) for word in ("--imu", f"{imu}={table}")]
        service = world.serve(*served)
        published = "".join(f'[[publish]]\nimu = "{imu}"\n' for imu in IMUS)
        node = world.node(world.write("node.toml", f"format = 1\n{published}"))
        subscriber = world.start([BUILT / "examples/bare", "count", *map(topic, IMUS)])
        for imu in IMUS:
            node.wait_for(f"{topic(imu)}: 1 subscribers")
        measured = [node, service, subscriber]
        before, begin = [processor_s(running.process.pid) for running in measured], time.monotonic()
        feed = [BUILT / "examples/bare", "feed", str(seconds), *(f"{imu}={rate}" for imu, rate in IMUS.items())]
        subprocess.run(feed, env=world.env, cwd=world.folder, check=True)
        passed = time.monotonic() - begin
        parts = [100 * (processor_s(running.process.pid) - old) / passed for running, old in zip(measured, before)]
        expected = {topic(imu): rate * seconds for imu, rate in IMUS.items()}
        # Until all are there, or no more has come for some seconds.
        last = [{}] * 5
        while last[-1] != expected and (last[0] != last[-1] or not last[-1]):
            subscriber.wait_for_messages(len(subscriber.messages()) + 1)
            last = [*last[1:], subscriber.messages()[-1]]
        lost = {name: expected[name] - count for name, count in last[-1].items()}
        missing.append(sum(lost.values()))
        print(f"{sum(expected.values())} messages in {passed:.1f} s, {missing[-1]} missing {lost if missing[-1] else ''}")
        print("of a core: node {:.0f} %, service {:.0f} %, subscriber {:.0f} %".format(*parts))
        assert node.end() == 0
        print("\n".join(line for line in node.lines if " published, " in line))

    with_world(within)
    return missing != [0]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=120)
    sys.exit(run(parser.parse_args().seconds))
