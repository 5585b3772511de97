"""Data of other programs, and ROS messages, which ROS's own message libraries read and write."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from typing import Any

import isotherm
import numpy as np
import pandas as pd
import pytest
from conftest import BINARY, REPOSITORY, RUN, TABLE, WHOLE_TABLE
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

DATA = REPOSITORY / "recording/formats/tests/data/convert"
SOURCE, MAPPING, EXPECTED = DATA / "source.csv", DATA / "mapping.toml", DATA / "source.expected.csv"
ROS = get_typestore(Stores.ROS2_HUMBLE)
IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([BINARY, *arguments], check=True, capture_output=True, text=True, timeout=200)


def celsius(tmp_path: Path) -> Path:
    """The table with its temperature in degC."""
    path = tmp_path / "celsius.toml"
    path.write_text(TABLE.read_text().replace('unit = "V"', 'unit = "degC"'))
    return path


def messages(path: Path) -> tuple[dict[str, list[Any]], list[dict[str, str]]]:
    """The decoded messages of a file by topic, and the metadata about tables."""
    decoded: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, value in reader.iter_decoded_messages():
            stamp = value.header.stamp
            assert message.publish_time == stamp.sec * 10**9 + stamp.nanosec
            decoded.setdefault(channel.topic, []).append(value)
        return decoded, [record.metadata for record in reader.iter_metadata() if record.name == "isotherm.table"]


def test_a_file_an_array_a_frame_and_columns_are_the_same_samples(tmp_path: Path) -> None:
    right = isotherm.read_recording(EXPECTED)
    assert isotherm.convert(SOURCE, MAPPING).tobytes() == right.tobytes()
    mapping = tomllib.loads(MAPPING.read_text())
    frame = pd.read_csv(SOURCE)
    assert isotherm.convert(frame, mapping).tobytes() == right.tobytes()
    assert isotherm.convert(frame, MAPPING).tobytes() == right.tobytes()
    assert isotherm.convert({name: frame[name].to_numpy() for name in frame}, mapping).tobytes() == right.tobytes()
    assert isotherm.convert(frame.to_records(index=False), mapping).tobytes() == right.tobytes()
    numbers = {
        "time": mapping["time"] | {"column": 1},
        "accelerometer": mapping["accelerometer"] | {"columns": [2, 3, 4]},
        "gyroscope": mapping["gyroscope"] | {"columns": [5, 6, 7]},
        "temperature": {"constant": 25},
    }
    # In an array of floats no number is whole, but the resolution is given.
    assert isotherm.convert(frame.to_numpy(), numbers).tobytes() == right.tobytes()
    # A time of pandas is in ns.
    times = frame.assign(time_s=pd.to_datetime((frame["time_s"] * 1e9).round().astype("int64")))
    assert isotherm.convert(times, mapping | {"time": mapping["time"] | {"unit": "ns"}}).tobytes() == right.tobytes()
    path = tmp_path / "written.csv"
    isotherm.write_recording(path, isotherm.convert(SOURCE, MAPPING, temperature=7.5, interval=0.1))
    written = isotherm.read_recording(path)
    assert (written["interval_ns"] == 100_000_000).all() and (written["accelerometers"]["head_temperature"] == 7.5).all()


def test_what_is_wrong_raises_and_what_is_odd_warns(tmp_path: Path) -> None:
    frame = pd.DataFrame({"t": [0.0, 0.01, 0.05], "ax": [1.5, 2.0, 3.0], "ay": [0.0, 0.0, 1.0], "az": [9.8, 9.8, 9.8]})
    with pytest.raises(ValueError, match="which columns are what") as refused:
        isotherm.convert(frame)
    proposal = str(refused.value).split("\n\n", 1)[1]
    mapping = tomllib.loads(proposal)
    assert mapping["accelerometer"]["columns"] == ["ax", "ay", "az"]
    mapping["time"]["unit"], mapping["accelerometer"]["unit"] = "s", "m/s2"
    with pytest.warns(UserWarning, match="1 gaps"):
        samples = isotherm.convert(frame, mapping | {"time": mapping["time"] | {"interval_s": 0.01}})
    assert samples["accelerometers"]["positive_pulses"].tolist()[0] == [1_500_000, 0, 9_800_000]
    assert samples["sequence"].tolist() == [0, 1, 5]
    with pytest.raises(isotherm.TableError, match="mapping:") as faults:
        isotherm.convert(frame, mapping | {"accelerometer": {"columns": ["ax", "ay"], "kind": "speed"}})
    assert [key for _, key, _ in faults.value.faults] == ["accelerometer.columns", "accelerometer.kind"]
    with pytest.raises(isotherm.RecordingFault, match="missing columns: ay") as missing:
        isotherm.convert(frame.rename(columns={"ay": "a_y"}), mapping)
    assert missing.value.line is None
    with pytest.raises(isotherm.RecordingFault, match="array: row 0: 2 rows have stamps that cannot be right") as falls:
        isotherm.convert(frame.assign(t=[1.0, 0.6, 0.5]), mapping | {"time": mapping["time"] | {"interval_s": 0.01}})
    assert falls.value.line == 0
    with pytest.raises(FileNotFoundError):
        isotherm.convert(tmp_path / "none.csv", mapping)
    with pytest.raises(ValueError, match="interval is 0"):
        isotherm.convert(frame, mapping, interval=0.0)
    with pytest.raises(ValueError, match="temperature is nan"):
        isotherm.convert(frame, mapping, temperature=float("nan"))
    with pytest.raises(ValueError, match="of one length"):
        isotherm.convert({"t": [1, 2], "ax": [1]}, mapping)
    with pytest.raises(ValueError, match="1 dimensions"):
        isotherm.convert(np.zeros(4), mapping)


def test_replayed_increments_are_messages_of_ros(tmp_path: Path) -> None:
    path, table = tmp_path / "run.mcap", celsius(tmp_path)
    command("replay", "--table", table, RUN, "-o", path)
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        # Names and order of the fields, of each message and of all that it contains, are those of ROS.
        for schema in summary.schemas.values():
            assert schema.encoding == "ros2msg"
            types = get_types_from_msg(schema.data.decode(), schema.name)
            assert schema.name in types
            for name, definition in types.items():
                assert definition == ROS.fielddefs[name], name
        assert {schema.name for schema in summary.schemas.values()} == {IMU, TEMPERATURE}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        # Two libraries read the same bytes.
        for schema, _, message in reader.iter_messages():
            assert schema is not None
            value: Any = ROS.deserialize_cdr(message.data, schema.name)
            assert value.header.frame_id == "imu-a"
            assert bytes(ROS.serialize_cdr(value, schema.name)) == message.data
    decoded, tables = messages(path)
    known = isotherm.Table.load(table)
    assert tables == [{"imu": "imu-a", "table": f"{known.id:016x}", "digest": known.digest, "file": "celsius.toml"}]
    samples = isotherm.read_recording(RUN)
    increments = isotherm.replay(known, samples)
    imus = decoded["/imu_a/data_raw"]
    assert len(imus) == len(increments)
    seconds = increments["interval_ns"] / 1e9
    for imu, increment, second in zip(imus, increments, seconds, strict=True):
        assert imu.header.stamp.sec * 10**9 + imu.header.stamp.nanosec == increment["timestamp_ns"]
        force = imu.linear_acceleration
        assert [force.x, force.y, force.z] == (increment["velocity_increment"] / second).tolist()
        # There is no orientation, and this IMU has no gyroscopes.
        assert imu.orientation_covariance[0] == -1.0 and imu.angular_velocity_covariance[0] == -1.0
        assert list(imu.linear_acceleration_covariance) == [0.0] * 9
    heads = samples["accelerometers"]["head_temperature"].mean(axis=1)
    assert np.allclose([value.temperature for value in decoded["/imu_a/temperature"]], heads, rtol=0, atol=1e-12)


def test_messages_are_converted_back(tmp_path: Path) -> None:
    path, table = tmp_path / "run.mcap", celsius(tmp_path)
    command("replay", "--table", table, RUN, "-o", path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        back = isotherm.convert(path)
    command("convert", path, "-o", tmp_path / "back.csv")
    assert isotherm.read_recording(tmp_path / "back.csv").tobytes() == back.tobytes()
    known, samples = isotherm.Table.load(table), isotherm.read_recording(RUN)
    increments = isotherm.replay(known, samples)
    assert back["timestamp_ns"].tolist() == samples["timestamp_ns"].tolist()
    pulses = back["accelerometers"]["positive_pulses"].astype(float) - back["accelerometers"]["negative_pulses"]
    force = increments["velocity_increment"] / (increments["interval_ns"] / 1e9)[:, None]
    assert np.abs(pulses * 1e-6 - force).max() < 0.6e-6
    # The function writes the same messages as the command.
    isotherm.write_ros(tmp_path / "array.mcap", known, increments, samples=samples, table_file=table)
    assert (tmp_path / "array.mcap").read_bytes() == path.read_bytes()
    isotherm.write_ros(tmp_path / "alone.mcap", known, increments)
    assert set(messages(tmp_path / "alone.mcap")[0]) == {"/imu_a/data_raw"}
    with pytest.raises(ValueError, match="of one length"):
        isotherm.write_ros(tmp_path / "alone.mcap", known, increments, samples=samples[1:])


def test_gyroscopes_are_messages_too(tmp_path: Path, whole_table: isotherm.Table, whole: isotherm.Records) -> None:
    increments = isotherm.replay(whole_table, whole)
    isotherm.write_ros(tmp_path / "whole.mcap", whole_table, increments, samples=whole, table_file=WHOLE_TABLE)
    decoded, tables = messages(tmp_path / "whole.mcap")
    # The temperature is in V.
    assert set(decoded) == {"/imu_g/data_raw"} and tables[0]["file"] == WHOLE_TABLE.name
    for imu, increment in zip(decoded["/imu_g/data_raw"], increments, strict=True):
        rates = imu.angular_velocity
        assert [rates.x, rates.y, rates.z] == (increment["angle_increment"] / (increment["interval_ns"] / 1e9)).tolist()
        assert imu.angular_velocity_covariance[0] == 0.0
    with pytest.warns(UserWarning, match="no temperature"):
        back = isotherm.convert(tmp_path / "whole.mcap", interval=float(whole["interval_ns"][0]) / 1e9)
    net = back["gyroscopes"]["positive_pulses"].astype(float) - back["gyroscopes"]["negative_pulses"]
    rate = increments["angle_increment"] / (increments["interval_ns"] / 1e9)[:, None]
    assert np.abs(net * 1e-6 - rate).max() < 0.6e-6


def test_the_page_about_your_data_shows_a_program_that_works(tmp_path: Path) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```$", (REPOSITORY / "docs/your-data.md").read_text(), re.MULTILINE | re.DOTALL)
    rows = [f"{number * 0.08:.2f},0.1,{number / 1000},9.81,2.5\n" for number in range(10)]
    (tmp_path / "logger.csv").write_text("time_s,ax,ay,az,temperature\n" + "".join(rows))
    (tmp_path / "imu-a.toml").write_text(TABLE.read_text())
    assert len(blocks) == 2
    subprocess.run([sys.executable, "-W", "error", "-c", blocks[0]], cwd=tmp_path, check=True, timeout=100)
    assert len(messages(tmp_path / "run.mcap")[0]["/imu_a/data_raw"]) == 10
    # A text of another program, whose IMU warms up at rest and cools down again.
    number = np.arange(20_000)
    celsius = 35.0 - 15.0 * np.cos(2e-3 * np.pi * number / 20)
    generator = np.random.default_rng(3)
    g = np.array([0.01, -0.02, 1.0]) + 1e-4 * (celsius[:, None] - 35.0) + 1e-4 * generator.normal(size=(len(number), 3))
    texts = [" | ".join([f"{n / 10:.1f}", *(f"{axis:.7f}" for axis in a), f"{c:.4f}"]) for n, a, c in zip(number, g, celsius, strict=True)]
    (tmp_path / "logger.txt").write_text("A logger\n\n" + "\n".join(texts).replace(".", ",") + "\n")
    program = blocks[1] + "assert table.curves['A1', 'bias'] and noise['ax [g]'].N\n"
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=tmp_path, check=True, timeout=100)


def test_a_bag_of_another_program_is_converted(tmp_path: Path) -> None:
    types = ROS.types
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    zeros = np.zeros(9)
    bag = tmp_path / "bag"
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        imus = writer.add_connection("/imu/data_raw", IMU, typestore=ROS)
        temperatures = writer.add_connection("/imu/temperature", TEMPERATURE, typestore=ROS)
        for number in range(100):
            ns = 1_700_000_000_000_000_000 + number * 10_000_000
            stamp = header(time(ns // 10**9, ns % 10**9), "imu_link")
            temperature: Any = types[TEMPERATURE](stamp, 20.0 + number, 0.0)
            writer.write(temperatures, ns, ROS.serialize_cdr(temperature, TEMPERATURE))
            imu: Any = types[IMU](
                stamp, quaternion(0, 0, 0, 1), zeros, vector(0.25, -0.5, 0.0), zeros, vector(0.0, number / 8, -9.80665), zeros
            )
            writer.write(imus, ns, ROS.serialize_cdr(imu, IMU))
    (path,) = bag.glob("*.mcap")
    samples = isotherm.convert(path)
    assert (samples["interval_ns"] == 10_000_000).all()
    assert (np.diff(samples["timestamp_ns"].astype(np.int64)) == 10_000_000).all()
    assert samples["timestamp_ns"][0] == 1_700_000_000_000_000_000
    accelerometers, gyroscopes = samples["accelerometers"], samples["gyroscopes"]
    assert accelerometers["positive_pulses"].tolist() == [[0, number * 125_000, 0] for number in range(100)]
    assert accelerometers["negative_pulses"].tolist() == [[0, 0, 9_806_650]] * 100
    assert (gyroscopes["positive_pulses"] == [250_000, 0, 0]).all() and (gyroscopes["negative_pulses"] == [0, 500_000, 0]).all()
    assert accelerometers["head_temperature"].tolist() == [[20.0 + number] * 3 for number in range(100)]


def test_times_of_the_log_or_a_known_rate_and_a_file_of_gyroscopes(tmp_path: Path) -> None:
    rows = [f"{0.02 * row:.3f},0.1,0.2,{9.79 + 0.001 * (row % 7):.3f}" for row in range(200)]
    text, gyroscopes = tmp_path / "acc.csv", tmp_path / "gyr.csv"
    text.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    gyroscopes.write_text("t,x,y,z\n" + "\n".join(f"{0.02 * row + 0.005:.3f},0.01,0.02,0.03" for row in range(200)) + "\n")
    sensors = {"columns": ["x", "y", "z"], "kind": "reading", "resolution": 1e-6}
    mapping = {"time": {"column": "t", "unit": "s"}, "accelerometer": sensors, "temperature": {"constant": 20.0}}
    by_rate = isotherm.convert(text, mapping, time="rate", interval=0.05)
    assert (by_rate["timestamp_ns"] == 50_000_000 * np.arange(1, 201)).all()
    with pytest.raises(ValueError, match="not MCAP"):
        isotherm.convert(text, mapping, time="log")
    with pytest.raises(ValueError, match="time is 'clock'"):
        isotherm.convert(text, mapping, time="clock")  # type: ignore[arg-type]
    joined = isotherm.convert(text, mapping | {"gyroscope": sensors}, gyroscope_file=gyroscopes)
    assert len(joined) == 200 and (joined["gyroscopes"]["positive_pulses"] == [10_000, 20_000, 30_000]).all()
