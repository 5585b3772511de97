"""A peer of the tests: Cyclone DDS, as a process of its own, with the commands of peer_fastdds.py."""

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass, field

import driver
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


def nine():
    return field(default_factory=lambda: [0.0] * 9)


@dataclass
class Imu(IdlStruct, typename="sensor_msgs::msg::dds_::Imu_"):
    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: array[float64, 9] = nine()
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: array[float64, 9] = nine()
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: array[float64, 9] = nine()


@dataclass
class Temperature(IdlStruct, typename="sensor_msgs::msg::dds_::Temperature_"):
    header: Header = field(default_factory=Header)
    temperature: float64 = 0.0
    variance: float64 = 0.0


TYPES = {"Imu": Imu, "Temperature": Temperature}


def fields(message):
    found = {
        "stamp_ns": message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec,
        "frame": message.header.frame_id,
    }
    if isinstance(message, Imu):
        force, rate = message.linear_acceleration, message.angular_velocity
        found["force"] = [force.x, force.y, force.z]
        found["rate"] = [rate.x, rate.y, rate.z]
    else:
        found["temperature"] = message.temperature
    return found


def message_of(kind, found):
    sec, nanosec = divmod(found["stamp_ns"], 1_000_000_000)
    header = Header(Time(sec, nanosec), found.get("frame", ""))
    if kind == "Imu":
        return Imu(header=header, linear_acceleration=Vector3(*found["force"]), angular_velocity=Vector3(*found["rate"]))
    return Temperature(header=header, temperature=found["temperature"])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("do", choices=["subscribe", "publish", "drive"])
    parser.add_argument("topic")
    parser.add_argument("type", choices=TYPES)
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--depth", type=int, default=2000)
    driver.add_arguments(parser)
    arguments = parser.parse_args()
    reliability = (
        Policy.Reliability.BestEffort if arguments.best_effort else Policy.Reliability.Reliable(duration(seconds=10))
    )
    qos = Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(arguments.depth))
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    topic = Topic(participant, "rt" + arguments.topic, TYPES[arguments.type], qos=qos)
    if arguments.do == "subscribe":
        reader = DataReader(participant, topic, qos=qos)
        print("ready", flush=True)
        while True:
            for message in reader.take_iter(timeout=duration(seconds=600)):
                print(json.dumps(fields(message)), flush=True)
    writer = DataWriter(participant, topic, qos=qos)
    while not writer.get_matched_subscriptions():
        time.sleep(0.05)
    print("matched", flush=True)
    if arguments.do == "drive":
        driver.drive(arguments, lambda found: writer.write(message_of(arguments.type, found)))
        print("driven", flush=True)
    for line in sys.stdin:
        writer.write(message_of(arguments.type, json.loads(line)))
        print("published", flush=True)
    writer.wait_for_acks(duration(seconds=10))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
