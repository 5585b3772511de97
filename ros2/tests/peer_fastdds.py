"""A peer of the tests: rclpy with Fast DDS, as a process of its own.

subscribe TOPIC TYPE    prints every message as a line of JSON, after a line `ready`
publish TOPIC TYPE      publishes each line of JSON on stdin, after a line `matched` when a subscriber is there
drive TOPIC TYPE        publishes what driver.py makes up, likewise
"""

import argparse
import json
import sys
import time

import driver
import rclpy
import rclpy.parameter
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, Temperature

TYPES = {"Imu": Imu, "Temperature": Temperature, "DiagnosticArray": DiagnosticArray}


def stamp_ns(header):
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def fields(message):
    """A message as numbers and texts."""
    found = {"stamp_ns": stamp_ns(message.header), "frame": message.header.frame_id}
    if isinstance(message, Imu):
        force, rate = message.linear_acceleration, message.angular_velocity
        found["force"] = [force.x, force.y, force.z]
        found["rate"] = [rate.x, rate.y, rate.z]
        found["covariances"] = [
            list(message.orientation_covariance),
            list(message.angular_velocity_covariance),
            list(message.linear_acceleration_covariance),
        ]
    elif isinstance(message, Temperature):
        found["temperature"] = message.temperature
    else:
        found["status"] = [
            {
                "level": ord(status.level),
                "name": status.name,
                "message": status.message,
                "hardware_id": status.hardware_id,
                "values": {value.key: value.value for value in status.values},
            }
            for status in message.status
        ]
    return found


def message_of(kind, found):
    message = TYPES[kind]()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(found["stamp_ns"], 1_000_000_000)
    message.header.frame_id = found.get("frame", "")
    if kind == "Imu":
        force, rate = message.linear_acceleration, message.angular_velocity
        force.x, force.y, force.z = found["force"]
        rate.x, rate.y, rate.z = found["rate"]
    else:
        message.temperature = found["temperature"]
    return message


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("do", choices=["subscribe", "publish", "drive"])
    parser.add_argument("topic")
    parser.add_argument("type", choices=TYPES)
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--depth", type=int, default=2000)
    parser.add_argument("--latencies", type=int, help="print those of so many messages, and end")
    parser.add_argument("--after", type=int, default=0, help="so many messages")
    parser.add_argument("--simulated-time", action="store_true", help="follow /clock")
    driver.add_arguments(parser)
    arguments = parser.parse_args()
    reliability = ReliabilityPolicy.BEST_EFFORT if arguments.best_effort else ReliabilityPolicy.RELIABLE
    qos = QoSProfile(
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=arguments.depth,
    )
    rclpy.init()
    simulated = rclpy.parameter.Parameter("use_sim_time", value=arguments.simulated_time)
    node = rclpy.create_node(f"peer_{arguments.do}", parameter_overrides=[simulated])
    if arguments.do == "subscribe":

        def take(message):
            print(json.dumps(fields(message)), flush=True)

        latencies = {"of_stamp_us": [], "of_source_us": []}

        def measure(message, info):
            now = time.time_ns()
            latencies["of_stamp_us"].append((now - stamp_ns(message.header)) / 1e3)
            latencies["of_source_us"].append((now - info["source_timestamp"]) / 1e3)
            if len(latencies["of_stamp_us"]) == arguments.latencies + arguments.after:
                print(json.dumps({key: all[arguments.after :] for key, all in latencies.items()}), flush=True)

        called = measure if arguments.latencies else take
        node.create_subscription(TYPES[arguments.type], arguments.topic, called, qos)
        print("ready", flush=True)
        rclpy.spin(node)
    publisher = node.create_publisher(TYPES[arguments.type], arguments.topic, qos)
    while publisher.get_subscription_count() == 0:
        rclpy.spin_once(node, timeout_sec=0.05)
    print("matched", flush=True)
    if arguments.do == "drive":
        driver.drive(arguments, lambda found: publisher.publish(message_of(arguments.type, found)))
        print("driven", flush=True)
    for line in sys.stdin:
        publisher.publish(message_of(arguments.type, json.loads(line)))
        print("published", flush=True)
    publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
