"""Calibration without a turntable: what the command gives, on arrays, data frames and files."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import isotherm
import pytest
from conftest import BINARY, REPOSITORY

XSENS = REPOSITORY / "calibration/tests/data/any_lab/xsens/recording.csv"
CAMPAIGN = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
RANGE = (0.0, 50.0)


def without_what_differs(text: str) -> str:
    """A table file without the lines for the program, the time and the files."""
    return re.sub(r"^(tool|time|campaign|campaign_sha256|recordings_sha256) = .*\n", "", text, flags=re.MULTILINE)


def test_the_table_is_that_of_the_command(tmp_path: Path) -> None:
    output = tmp_path / "x.toml"
    arguments = ["--imu", "imu-x", "--gravity-local", "9.81", "--gravity-reference", "9.81", "--temperature-unit", "degC"]
    command = [BINARY, "calibrate", "--gravity-only", XSENS, *arguments, "--temperature-range", "0,50", "-o", output]
    subprocess.run(command, check=True, capture_output=True, timeout=200)
    samples = isotherm.read_recording(XSENS)
    import pandas as pd

    frame = pd.read_csv(XSENS)
    for recordings in (XSENS, samples, frame, [samples]):
        found = isotherm.calibrate_gravity_only(CAMPAIGN, recordings, temperature_range=RANGE)
        assert without_what_differs(found.text) == without_what_differs(output.read_text())
    assert found.summary["standstills"] == 40 and found.summary["residual_rms_g0"] < 0.11e-3
    assert "40 standstills" in str(found)
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
    ferraris = REPOSITORY / "calibration/tests/data/any_lab/ferraris/recording.csv"
    with pytest.raises(isotherm.CalibrationError, match="m12, m13, m23"):
        isotherm.calibrate_gravity_only(CAMPAIGN, ferraris, temperature_range=RANGE)
    found = isotherm.calibrate_gravity_only(CAMPAIGN, ferraris, temperature_range=RANGE, misalignment=False)
    assert found.summary["bias_standard_error_g0"] is None
    with pytest.raises(ValueError, match="window"):
        isotherm.calibrate_gravity_only(CAMPAIGN, ferraris, window=0.0)
    with pytest.raises(ValueError, match="scale_factor"):
        isotherm.calibrate_gravity_only(CAMPAIGN, ferraris, scale_factor="both")  # type: ignore[arg-type]
