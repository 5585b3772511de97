"""Calibration at one attitude, of a real warm-up as logs of both autopilots."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import isotherm

from conftest import BINARY

LOGS = Path(__file__).parents[2] / "recording/formats/tests/data/autopilots"


def log() -> Path:
    return LOGS / "heating.BIN"


def test_a_log_gives_the_table_that_the_command_gives(tmp_path: Path) -> None:
    found = isotherm.calibrate_warm_up(log(), "imu-b", lag="none", beside=["px4"])
    table, document = tmp_path / "imu-b.toml", found.summary
    command = [BINARY, "calibrate", "warm-up", log(), "--imu", "imu-b", "--lag", "none", "-o", table]
    subprocess.run(command, check=True, capture_output=True)
    assert isotherm.Table.load(table).digest == found.table.digest
    assert found.table.nominal_interval_s == pytest.approx(0.1)
    assert document["order"]["left_out"] == "none"
    assert [bias["beside"][0]["name"] for bias in document["biases"]] == ["PX4"] * 6
    assert any("[one-direction]" in message for _, _, message in found.findings)
    assert "not known" in found.accuracy


def test_arrays_need_a_nominal_table() -> None:
    samples = isotherm.convert(log())
    with pytest.raises(ValueError, match="nominal"):
        isotherm.calibrate_warm_up(samples, "imu-b")
    of_file = isotherm.calibrate_warm_up(log(), "imu-b", lag="none")
    content = of_file.table
    again = isotherm.calibrate_warm_up(samples, "imu-b", nominal=content, lag="none", accept=["one-direction"])
    assert again.accuracy == of_file.accuracy


def test_wrong_arguments_are_named() -> None:
    for given, message in (
        ({"at": float("nan")}, "at is nan"),
        ({"gravity_reference": 10.0}, "gravity_reference is 10.0"),
        ({"lag": 0}, "lag is 0"),
        ({"beside": ["ardu"]}, "beside"),
        ({"order": 8}, "order is 8"),
    ):
        with pytest.raises(ValueError, match=message):
            isotherm.calibrate_warm_up(log(), "imu-b", **given)
