"""Calibration without a turntable: what the command gives, on arrays, data frames and files."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import isotherm
import numpy as np
import pytest
from conftest import BINARY, REPOSITORY

XSENS = REPOSITORY / "calibration/fit/tests/data/any_lab/xsens/recording.csv"
CAMPAIGN = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
RANGE = (0.0, 50.0)


def without_what_differs(text: str) -> str:
    """A table file without the lines for the program, the time and the files."""
    return re.sub(r"^(tool|time|campaign|campaign_sha256|recordings_sha256) = .*\n", "", text, flags=re.MULTILINE)


def test_the_table_is_that_of_the_command(tmp_path: Path) -> None:
    output = tmp_path / "x.toml"
    arguments = ["--imu", "imu-x", "--gravity-local", "9.81", "--gravity-reference", "9.81", "--temperature-unit", "degC"]
    command = [BINARY, "calibrate", "tumble", XSENS, *arguments, "--temperature-range", "0,50", "-o", output]
    subprocess.run(command, check=True, capture_output=True, timeout=200)
    samples = isotherm.read_recording(XSENS)
    import pandas as pd

    frame = pd.read_csv(XSENS)
    for recordings in (XSENS, samples, frame, [samples]):
        found = isotherm.calibrate_tumble(CAMPAIGN, recordings, temperature_range=RANGE)
        assert without_what_differs(found.text) == without_what_differs(output.read_text())
    assert found.summary["static_poses"] == 40 and found.summary["residual_rms_g0"] < 0.11e-3
    assert "40 static poses" in str(found)
    found.save(tmp_path / "y.toml", report=tmp_path / "y.html")
    assert isotherm.Table.load(tmp_path / "y.toml").digest == found.table.digest

    document = isotherm.lengths(found.table, samples, require="scale=500ppm")
    command = [BINARY, "verify", "--table", output, XSENS, "--require", "scale=500ppm", "--json"]
    printed = subprocess.run(command, capture_output=True, timeout=200)
    assert printed.returncode == 1 and json.loads(printed.stdout) == document
    # The bound is kept, but by the recording that made the table.
    bounds = {judged["bound"]: judged["message"] for judged in document["judgements"]}
    assert not document["met"] and document["made_the_table"] and bounds["scale"].endswith("not judged, see below")
    assert bounds["own recording"] == "Nothing can be claimed: this recording made the table: no evidence."


def test_what_is_not_determined_is_refused_by_name() -> None:
    ferraris = REPOSITORY / "calibration/fit/tests/data/any_lab/ferraris/recording.csv"
    with pytest.raises(isotherm.CalibrationError, match="m12, m13, m23"):
        isotherm.calibrate_tumble(CAMPAIGN, ferraris, temperature_range=RANGE)
    found = isotherm.calibrate_tumble(CAMPAIGN, ferraris, temperature_range=RANGE, misalignment=False)
    assert found.summary["bias_standard_error_g0"] is None
    with pytest.raises(ValueError, match="window"):
        isotherm.calibrate_tumble(CAMPAIGN, ferraris, window=0.0)
    with pytest.raises(ValueError, match="scale_factor"):
        isotherm.calibrate_tumble(CAMPAIGN, ferraris, scale_factor="both")  # type: ignore[arg-type]


def test_local_gravity_is_that_of_latitude_and_height(tmp_path: Path) -> None:
    output = tmp_path / "x.toml"
    arguments = ["--imu", "imu-x", "--latitude", "50", "--height", "-20.5", "--gravity-reference", "9.81", "--temperature-unit", "degC"]
    command = [BINARY, "calibrate", "tumble", XSENS, *arguments, "--temperature-range", "0,50", "-o", output]
    subprocess.run(command, check=True, capture_output=True, timeout=200)
    unknown = {key: value for key, value in CAMPAIGN.items() if key != "gravity_local"}
    found = isotherm.calibrate_tumble(unknown, XSENS, latitude=50, height=-20.5, temperature_range=RANGE)
    assert without_what_differs(found.text) == without_what_differs(output.read_text())
    assert 'gravity_source = "normal"' in found.text
    assert found.summary["gravity_half_width_ppm"] == pytest.approx(102.0)
    # Stated, it is checked.
    right = isotherm.calibrate_tumble(CAMPAIGN, XSENS, latitude=50, height=200, temperature_range=RANGE)
    wrong = isotherm.calibrate_tumble(CAMPAIGN, XSENS, latitude=50, height=1400, temperature_range=RANGE)
    assert not any("local-gravity" in str(each) for each in right.findings)
    assert sum("local-gravity" in str(each) for each in wrong.findings) == 1
    assert right.summary["gravity_half_width_ppm"] is None


@pytest.mark.parametrize(
    "given, message",
    [
        ({"latitude": 50}, "both latitude and height"),
        ({"height": 50}, "both latitude and height"),
        ({"latitude": 91, "height": 0}, "latitude is 91, give -90 to 90 deg"),
        ({"latitude": float("nan"), "height": 0}, "latitude is nan"),
        ({"latitude": 0, "height": float("inf")}, "height is inf, give -1000 to 9000 m"),
    ],
)
def test_a_place_that_is_none_is_refused(given: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        isotherm.calibrate_tumble(CAMPAIGN, XSENS, temperature_range=RANGE, **given)


def test_files_of_other_programs_are_read_with_a_mapping(tmp_path: Path) -> None:
    samples = isotherm.read_recording(XSENS)
    triad = samples["accelerometers"]
    net = triad["positive_pulses"].astype("int64") - triad["negative_pulses"]
    rows = [f"{t},{x},{y},{z}" for t, (x, y, z) in zip(samples["timestamp_ns"], net, strict=True)]
    text = tmp_path / "text.csv"
    text.write_text("\n".join(["t,x,y,z", *rows]) + "\n")
    mapping = {
        "time": {"column": "t", "unit": "ns", "interval_s": float(samples["interval_ns"][0]) / 1e9},
        "accelerometer": {"columns": ["x", "y", "z"], "kind": "reading", "resolution": 1},
        "temperature": {"constant": float(triad["head_temperature"][0, 0])},
    }
    converted = isotherm.calibrate_tumble(CAMPAIGN, isotherm.convert(text, mapping), temperature_range=RANGE)
    direct = isotherm.calibrate_tumble(CAMPAIGN, text, temperature_range=RANGE, mapping=mapping)
    assert direct.table.digest == converted.table.digest
    with pytest.raises(ValueError, match="which columns are what"):
        isotherm.calibrate_tumble(CAMPAIGN, text, temperature_range=RANGE)
    with pytest.raises(ValueError, match="leave out what is for other data: mapping, interval"):
        isotherm.calibrate_tumble(CAMPAIGN, XSENS, mapping=mapping, interval=0.01)
    with pytest.raises(isotherm.TableError, match="accelerometer.kind"):
        wrong = mapping | {"accelerometer": {"columns": ["x", "y", "z"], "kind": "speed"}}
        isotherm.calibrate_tumble(CAMPAIGN, text, mapping=wrong)
    with pytest.raises(ValueError, match="interval is 0"):
        isotherm.calibrate_tumble(CAMPAIGN, text, mapping=mapping, interval=0)


def test_a_tumble_has_poses_residuals_and_accuracy() -> None:
    found = isotherm.calibrate_tumble(CAMPAIGN, XSENS, temperature_range=RANGE)
    assert len(found.dwells) == 40 and found.residuals.shape == (40, 1)
    assert np.sqrt((found.residuals**2).mean()) == pytest.approx(found.summary["residual_rms_g0"])
    samples = isotherm.read_recording(XSENS)
    rows = [row for _, _, first, last, _ in found.dwells for row in (first, last)]
    assert rows == sorted(rows) and 0 <= rows[0] and rows[-1] < len(samples)
    assert [number for _, number, *_ in found.dwells] == list(range(1, 41))
    for temperature, _, first, last, seconds in found.dwells:
        part = samples[first : last + 1]
        assert temperature == pytest.approx(part["accelerometers"]["head_temperature"].mean())
        assert 0.0 < seconds <= part["interval_ns"].sum() / 1e9 + 1e-9
    assert re.fullmatch(
        r"bias \+- .*e-6 g0, scale factor \+- .* ppm over .* degC, 95 % for each whole curve, from 40 static poses, residuals .*e-6 g0 rms",
        found.accuracy,
    )
