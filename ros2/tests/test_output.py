"""Out of Isotherm: what peers of ROS 2 get of a real service."""

import math

import pytest
from conftest import ROOT, rows, same

TABLE = ROOT / "tests/data/imu-a.toml"
RUN = ROOT / "tests/data/run.csv"
NODE = 'format = 1\n[[publish]]\nimu = "imu-a"\nclock = "other"\n'


def serve(world):
    return world.serve("--imu", f"imu-a={TABLE}")


@pytest.mark.parametrize("peer", ["fastdds", "cyclonedds"])
@pytest.mark.parametrize("quality", [[], ["--best-effort"]])
def test_a_subscriber_gets_every_sample(world, peer, quality):
    serve(world)
    node = world.node(world.write("node.toml", NODE))
    subscriber = world.peer(peer, "subscribe", "/imu_a/imu/data_raw", "Imu", *quality)
    node.wait_for("/imu_a/imu/data_raw: 1 subscribers")
    fed = rows(world.isotherm("feed", "--imu", "imu-a", RUN, "--rate", "400"))
    messages = subscriber.wait_for_messages(len(fed))
    assert len(messages) == len(fed)
    for message, row in zip(messages, fed):
        assert same(message["force"], row["force"]), (message, row)
        assert message["frame"] == "imu_a" and message["rate"] == [0.0, 0.0, 0.0]
    if "covariances" in messages[0]:
        orientation, rate, force = messages[0]["covariances"]
        assert orientation[0] == -1.0 and rate[0] == -1.0 and force == [0.0] * 9
    # The stamps keep the distances of the timestamps, once the smallest delay has come.
    half = len(fed) // 2
    for (one, two), (before, after) in zip(zip(messages[half:], messages[half + 1 :]), zip(fed[half:], fed[half + 1 :])):
        step = two["stamp_ns"] - one["stamp_ns"]
        assert step <= after["timestamp_ns"] - before["timestamp_ns"]
    assert node.end() == 0
    assert f"imu-a: {len(fed)} published, 0 missing before, 0 invalid" in node.log()


def test_temperature_and_diagnostics(world):
    table = TABLE.read_text().replace('unit = "V"', 'unit = "degC"')
    world.serve("--imu", f"imu-a={world.write('imu-a.toml', table)}")
    node = world.node(world.write("node.toml", NODE))
    thermometer = world.peer("fastdds", "subscribe", "/imu_a/imu/temperature", "Temperature")
    diagnostics = world.peer("fastdds", "subscribe", "/diagnostics", "DiagnosticArray")
    subscriber = world.peer("fastdds", "subscribe", "/imu_a/imu/data_raw", "Imu")
    for peer in (thermometer, diagnostics, subscriber):
        peer.wait_for("ready")
    node.wait_for("/imu_a/imu/data_raw: 1 subscribers")
    diagnostics.wait_for_messages(1)
    fed = rows(world.isotherm("feed", "--imu", "imu-a", RUN, "--rate", "200"))
    thermometer.wait_for_messages(1)
    subscriber.wait_for_messages(len(fed))

    def imu():
        arrays = diagnostics.messages()
        return [status for array in arrays for status in array["status"] if status["name"] == "isotherm: imu-a"]

    diagnostics.wait_until(lambda: any(status["values"].get("published") == str(len(fed)) for status in imu()), "counts")
    last = imu()[-1]
    assert last["values"]["table"].startswith("sha256:") and last["values"]["clock"] == "other"
    assert thermometer.messages()[0]["frame"] == "imu_a"
    assert node.end() == 0


def test_a_clock_that_is_not_the_monotonic_one_is_found_out(world):
    serve(world)
    node = world.node("--imu", "imu-a")
    diagnostics = world.peer("fastdds", "subscribe", "/diagnostics", "DiagnosticArray")
    subscriber = world.peer("fastdds", "subscribe", "/imu_a/imu/data_raw", "Imu")
    diagnostics.wait_for("ready")
    node.wait_for("/imu_a/imu/data_raw: 1 subscribers")
    # Not faster than the node reads.
    fed = rows(world.isotherm("feed", "--imu", "imu-a", RUN, "--rate", "2000"))
    node.wait_for("are not of CLOCK_MONOTONIC")
    diagnostics.wait_for("give clock =")
    assert node.end() == 0
    assert f"imu-a: 0 published, 0 missing before, 0 invalid, {len(fed)} without a time" in node.log()
    assert subscriber.messages() == []


def test_simulated_time_and_static_peers_are_said_not_to_be_followed(world):
    refused = world.start([world.built / "isotherm-ros2", "--imu", "imu-a", "--ros-args", "-p", "use_sim_time:=true"])
    assert refused.process.wait(timeout=60) == 64
    refused.wait_for("--ros-args -p use_sim_time:=true: this node takes no arguments of ROS 2")
    refused.wait_for("simulated time (use_sim_time) is not followed")
    description = world.write("simulated.toml", NODE.replace("[[publish]]", "[ros2]\nuse_sim_time = true\n[[publish]]"))
    refused = world.start([world.built / "isotherm-ros2", description])
    assert refused.process.wait(timeout=60) == 78
    refused.wait_for("ros2.use_sim_time: simulated time (use_sim_time) is not followed")
    serve(world)
    world.env["ROS_STATIC_PEERS"] = "127.0.0.1"
    # Launch files end each command line so.
    node = world.node("--imu", "imu-a", "--ros-args")
    node.wait_for('ROS_STATIC_PEERS is "127.0.0.1", which this node does not follow')
    del world.env["ROS_STATIC_PEERS"]
    world.peer("fastdds", "subscribe", "/imu_a/imu/data_raw", "Imu", "--simulated-time")
    node.wait_for("/clock is in this domain: other nodes may be on simulated time")
    assert node.end() == 0


@pytest.mark.parametrize("policy", ["omit", "nan"])
def test_what_is_not_whole_is_counted_and_never_a_number(world, policy):
    serve(world)
    node = world.node(world.write("node.toml", NODE + f'invalid = "{policy}"\n'))
    lines = RUN.read_text().splitlines()[:101]
    names = lines[0].split(",")
    head = names.index("a2_head")
    for at in (5, 50, 100):
        values = lines[at].split(",")
        values[head] = "NaN"
        lines[at] = ",".join(values)
    subscriber = world.peer("fastdds", "subscribe", "/imu_a/imu/data_raw", "Imu")
    node.wait_for("/imu_a/imu/data_raw: 1 subscribers")
    recording = world.write("run.csv", "\n".join(lines) + "\n")
    fed = rows(world.isotherm("feed", "--imu", "imu-a", recording))
    whole = [row for row in fed if all(map(math.isfinite, row["force"]))]
    assert len(fed) - len(whole) == 3
    expected = whole if policy == "omit" else fed
    messages = subscriber.wait_for_messages(len(expected))
    assert all(same(message["force"], row["force"]) for message, row in zip(messages, expected))
    assert node.end() == 0
    assert "3 invalid" in node.log()
