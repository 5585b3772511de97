"""Into Isotherm: what becomes of a driver's topics, and out again."""

import csv

import pytest
from conftest import ROOT, rows, same

TABLE = ROOT / "examples/tables/imu-mems.toml"
NODE = """format = 1
[[publish]]
imu = "imu-mems"
[[subscribe]]
imu = "imu-mems"
topic = "/driver/imu/data_raw"
temperature_c = 25.0
gyroscope_resolution = 1e-7
interval_s = 0.0025
frame = "imu_link"
reliability = "reliable"
depth = 1000
"""
DRIVER = ("drive", "/driver/imu/data_raw", "Imu", "--rate", "400")


def replayed(world):
    """What was recorded, and its increments as `replay` has them."""
    recorded = list(csv.DictReader((world.folder / "recorded.csv").read_text().splitlines()))
    return recorded, rows(world.isotherm("replay", "--table", TABLE, "recorded.csv"))


def begin(world, description=NODE):
    world.serve("--imu", f"imu-mems={TABLE}")
    recorder = world.start([world.built / "isotherm", "record", "--imu", "imu-mems", "--stream", "raw", "-o", "recorded.csv"])
    recorder.wait_for("recording imu-mems")
    node = world.node(world.write("node.toml", description))
    node.wait_for("connected to the service")
    return recorder, node


@pytest.mark.parametrize("peer", ["fastdds", "cyclonedds"])
def test_a_driver_goes_in_and_comes_out_compensated(world, peer):
    recorder, node = begin(world)
    subscriber = world.peer(peer, "subscribe", "/imu_mems/imu/data_raw", "Imu")
    node.wait_for("/imu_mems/imu/data_raw: 1 subscribers")
    faults = ["--skip", "300,301,500", "--double", "400", "--nan", "600", "--foreign", "650", "--absurd", "700,701"]
    driver = world.peer(peer, *DRIVER, "--count", "1200", *faults)
    driver.wait_for("driven")
    # A lost period, one that is not a number, of another frame or without a time is a gap, each with its number.
    lost = {300, 301, 500, 600, 650, 700, 701}
    messages = subscriber.wait_for_messages(1200 - len(lost))
    assert node.end() == 0 and recorder.end() == 0
    recorded, increments = replayed(world)
    sequences = [int(row["sequence"]) for row in recorded]
    assert sequences == [period for period in range(1200) if period not in lost]
    assert len(messages) == len(increments)
    for message, increment in zip(messages, increments):
        assert same(message["force"], increment["force"]) and message["frame"] == "imu_mems"
    first = messages[0]["stamp_ns"]
    # The stamps are the driver's, to the nanosecond but for the rounding of the offset.
    for sequence, message in zip(sequences, messages):
        assert abs(message["stamp_ns"] - first - sequence * 2_500_000) < 1_000
    assert "1200 messages" not in node.log() and "1198 messages, 1 of another frame, 2 with an absurd stamp" in node.log()


def test_a_clock_of_another_machine_is_found_out_and_can_be_placed(world):
    recorder, node = begin(world)
    driver = world.peer("fastdds", *DRIVER, "--count", "300", "--behind", "5")
    node.wait_for("of another clock? then give clock =")
    driver.wait_for("driven")
    assert node.end() == 0
    assert "0 sent" in node.log()
    other = world.node(world.write("other.toml", NODE + 'clock = "other"\n'))
    other.wait_for("connected to the service")
    subscriber = world.peer("fastdds", "subscribe", "/imu_mems/imu/data_raw", "Imu")
    other.wait_for("/imu_mems/imu/data_raw: 1 subscribers")
    world.peer("fastdds", *DRIVER, "--count", "400", "--behind", "5").wait_for("driven")
    messages = subscriber.wait_for_messages(400)
    assert other.end() == 0 and recorder.end() == 0
    _, increments = replayed(world)
    assert all(same(message["force"], row["force"]) for message, row in zip(messages, increments))


def test_the_nodes_own_topic_is_refused_as_its_input(world):
    own = NODE.replace("/driver/imu/data_raw", "/imu_mems/imu/data_raw")
    node = world.start([world.built / "isotherm-ros2", world.write("node.toml", own)])
    assert node.process.wait(timeout=60) == 78
    node.wait_for("is what this node publishes")


def test_a_temperature_that_nobody_measures_is_said_and_not_published(world):
    recorder, node = begin(world)
    node.wait_for("no thermometer: the temperature is taken to be 25 degC, and nothing is compensated for it")
    diagnostics = world.peer("fastdds", "subscribe", "/diagnostics", "DiagnosticArray")
    # A topic that the node does not have: a publisher of the test's own is the only one.
    thermometer = world.peer("fastdds", "subscribe", "/imu_mems/imu/temperature", "Temperature")
    thermometer.wait_for("ready")
    driver = world.peer("fastdds", *DRIVER, "--count", "800")
    driver.wait_for("driven")

    def found():
        arrays = diagnostics.messages()
        all = [status["values"] for array in arrays for status in array["status"] if status["name"] == "isotherm: imu-mems"]
        return [values for values in all if values.get("received", "0") != "0"]

    diagnostics.wait_until(lambda: len(found()) > 1, "diagnostics with samples")
    assert found()[-1]["temperature"] == "taken to be 25 degC: there is no thermometer"
    assert not any(key.startswith("temperature_a") for key in found()[-1])
    own = world.peer("fastdds", "publish", "/imu_mems/imu/temperature", "Temperature")
    own.wait_for("matched")
    own.send({"stamp_ns": 0, "temperature": 31.5})
    assert [message["temperature"] for message in thermometer.wait_for_messages(1)] == [31.5]
    assert node.end() == 0 and recorder.end() == 0


def test_a_topic_of_another_type_is_said(world):
    recorder, node = begin(world)
    world.peer("fastdds", "subscribe", "/driver/imu/data_raw", "Temperature").wait_for("ready")
    node.wait_for("/driver/imu/data_raw is of type sensor_msgs::msg::dds_::Temperature_ elsewhere")
    assert node.end() == 0 and recorder.end() == 0


def test_a_thermometer_is_heard_and_one_that_is_no_number_counted(world):
    own = NODE.replace("temperature_c = 25.0", 'temperature_topic = "/driver/imu/temperature"')
    recorder, node = begin(world, own)
    thermometer = world.peer("fastdds", "publish", "/driver/imu/temperature", "Temperature")
    thermometer.wait_for("matched")
    driver = world.peer("fastdds", *DRIVER, "--count", "2000")
    driver.wait_for("matched")
    # What comes before the first temperature is no sample.
    node.wait_for("comes before the first temperature")
    for temperature in (float("nan"), 31.5):
        thermometer.send({"stamp_ns": 0, "temperature": temperature})
    driver.wait_for("driven")
    node.wait_until(lambda: world.status()["imus"][0]["compensated"] > 100, "samples")
    assert node.end() == 0 and recorder.end() == 0
    recorded, _ = replayed(world)
    assert {row["a1_head"] for row in recorded} == {"31.5"}
    assert "2 temperatures, 1 bad" in node.log()
