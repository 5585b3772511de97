"""A table that is made of a driver's bag fits the samples that the node makes of the same topics."""

import csv

from conftest import ROOT
from driver import message
from mcap_ros2.writer import Writer

IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
NODE = """format = 1
[[subscribe]]
imu = "imu-a"
topic = "/driver/imu/data_raw"
temperature_c = 25.0
interval_s = 0.0025
reliability = "reliable"
depth = 1000
"""
COUNT = 400


def vector(values):
    return dict(zip("xyz", values))


def write_bag(path):
    """The messages of driver.py, as `ros2 bag record -s mcap` keeps them."""
    with open(path, "wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for period in range(COUNT):
            found, stamp_ns = message(period), 1_700_000_000_000_000_000 + period * 2_500_000
            sec, nanosec = divmod(stamp_ns, 1_000_000_000)
            writer.write_message(
                topic="/driver/imu/data_raw",
                schema=schema,
                message={
                    "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": found["frame"]},
                    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                    "orientation_covariance": [-1.0] + [0.0] * 8,
                    "angular_velocity": vector(found["rate"]),
                    "angular_velocity_covariance": [0.0] * 9,
                    "linear_acceleration": vector(found["force"]),
                    "linear_acceleration_covariance": [0.0] * 9,
                },
                log_time=stamp_ns,
                publish_time=stamp_ns,
            )


def pulses(path):
    names = [f"{kind}{axis}_{sign}" for kind in "ag" for axis in (1, 2, 3) for sign in ("positive", "negative")]
    return [[int(row[name]) for name in names] for row in csv.DictReader(path.read_text().splitlines())]


def test_samples_of_the_node_are_those_of_the_bag(world):
    node = world.write("node.toml", NODE)
    world.run("isotherm-ros2", node, "--nominal", "imu-a.toml")
    assert "table of imu-a" in world.isotherm("check", "imu-a.toml")
    assert "subscribes to imu-a of /driver/imu/data_raw" in world.isotherm("check", node)
    world.serve("--imu", "imu-a=imu-a.toml")
    recorder = world.start([world.built / "isotherm", "record", "--imu", "imu-a", "--stream", "raw", "-o", "node.csv"])
    recorder.wait_for("recording imu-a")
    running = world.node(node)
    running.wait_for("connected to the service")
    driver = world.peer("fastdds", "drive", "/driver/imu/data_raw", "Imu", "--rate", "400", "--count", str(COUNT))
    driver.wait_for("driven")
    running.wait_until(lambda: world.status()["imus"][0]["compensated"] == COUNT, "all samples")
    assert running.end() == 0 and recorder.end() == 0
    write_bag(world.folder / "drive.mcap")
    world.isotherm("convert", "drive.mcap", "--temperature", "25", "--interval", "0.0025", "-o", "bag.csv")
    assert pulses(world.folder / "node.csv") == pulses(world.folder / "bag.csv")


def test_the_status_puts_timestamps_on_unix_time(world):
    world.serve("--imu", f"imu-a={ROOT / 'tests/data/imu-a.toml'}")
    status = world.status()
    unix_ns = status["taken_ns"] + status["unix_offset_ns"]
    assert abs(unix_ns / 1e9 - status["started_unix_s"] - status["uptime_s"]) < 1.0
    assert 0 < status["unix_offset_uncertainty_ns"] < 1_000_000_000 and status["unix_steps"] == 0
