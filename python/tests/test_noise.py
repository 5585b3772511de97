"""The noise of rates and recordings: against allantools, and against the command."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import allantools
import isotherm
import numpy as np
import pandas as pd
import pytest
from conftest import BINARY


def rates(rows: int, seed: int = 1) -> np.ndarray:
    """White noise, a little random walk, and an offset."""
    random = np.random.default_rng(seed)
    return 100.0 + random.normal(size=rows) + 0.01 * np.cumsum(random.normal(size=rows))


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 18 minutes at rest with its table, in a folder."""
    folder = tmp_path_factory.mktemp("night")
    simulate = ["simulate", "run", "-o", "night", "--temperatures", "20,20.3", "--ramp", "1", "--hold", "1", "--sensor-noise", "40"]
    subprocess.run([BINARY, *simulate, "--seed", "3"], check=True, cwd=folder, capture_output=True)
    return folder / "night"


def test_deviations_are_those_of_allantools() -> None:
    values = rates(10_000)
    for interval in (1.0, 0.01):
        found = isotherm.noise(values, interval=interval)
        times = np.array(found["tau_s"])
        tau, deviation, _, _ = allantools.oadev(values, rate=1 / interval, data_type="freq", taus=times)
        assert np.allclose(tau, times, rtol=1e-12)
        assert np.allclose(deviation, found["adev_in_unit"], rtol=1e-12, atol=0.0)


def test_degrees_of_freedom_are_those_of_greenhall_and_riley() -> None:
    # Of white noise, from m = 64 on. The model of only white noise has the other coefficients at 0, or nearly so.
    rows = 32_768
    found = isotherm.noise(np.random.default_rng(5).normal(size=rows), interval=1.0)
    coefficients = {it["letter"]: it for it in found["model"]["coefficients"]}
    assert all(coefficients[letter]["below_in_unit"] is not None for letter in "QBK")
    factors = np.array(found["tau_s"]).astype(int)
    white = np.array([coefficients["N"]["value_in_unit"] ** 2 / m for m in factors])
    modelled = sum(
        coefficients[letter]["value_in_unit"] ** 2 * part
        for letter, part in zip("QNBK", (3 / factors**2, 1 / factors, 2 * np.log(2) / np.pi + 0 * factors, factors / 3), strict=True)
    )
    compared = 0
    for m, freedom, part in zip(factors, found["degrees_of_freedom"], white / modelled, strict=True):
        if m >= 64 and m <= rows // 8 and part > 0.999:
            right = allantools.edf_greenhall(alpha=0, d=2, m=int(m), N=rows + 1, overlapping=True, modified=False)
            assert freedom == pytest.approx(right, rel=5e-3), m
            compared += 1
    assert compared >= 10


def test_a_recording_is_the_document_of_the_command(night: Path, tmp_path: Path) -> None:
    arguments = ["noise", night / "run.csv", "--table", night / "truth.toml", "--json", "--from", "100", "--to", "900"]
    printed = subprocess.run([BINARY, *arguments, "--kalibr", tmp_path / "command.yaml"], check=True, capture_output=True, text=True).stdout
    table, samples = isotherm.Table.load(night / "truth.toml"), isotherm.read_recording(night / "run.csv")
    files = {"report": tmp_path / "r.html", "kalibr": tmp_path / "array.yaml"}
    found = isotherm.noise(samples, table=table, start=100.0, end=900.0, **files)
    document = json.loads(printed)
    # The command reads no further than the end that it is given.
    assert (document.pop("recorded_rows"), found.pop("recorded_rows")) == (9000, len(samples))
    assert found == document
    assert found["rows"] == 8000 and found["sensors"][0]["unit"] == "g0"
    assert "<svg" in files["report"].read_text()
    # The first line has the name of the recording.
    lines = [(tmp_path / name).read_text().splitlines() for name in ("command.yaml", "array.yaml")]
    assert lines[0][1:] == lines[1][1:] and lines[0][2] == "update_rate: 10.000000  # Hz"
    # A data frame, without a table.
    counts = isotherm.noise(pd.read_csv(night / "run.csv"))
    assert counts["sensors"][0]["unit"] == "pulse/s" and counts["rows"] == len(samples)
    # Only the rates have the same curve.
    net = samples["accelerometers"]["positive_pulses"][:, 0].astype(float) - samples["accelerometers"]["negative_pulses"][:, 0]
    alone = isotherm.noise(net / 0.1, interval=0.1, temperature=samples["accelerometers"]["head_temperature"][:, 0])
    assert np.allclose(alone["adev_in_unit"], counts["sensors"][0]["adev_in_unit"], rtol=1e-9)
    assert alone["temperature"]["slope_in_unit"] == pytest.approx(counts["sensors"][0]["temperature"]["slope_in_unit"], rel=1e-6)


def test_what_is_refused(night: Path, tmp_path: Path) -> None:
    samples = isotherm.read_recording(night / "run.csv")
    with pytest.raises(isotherm.NoiseError, match="999 rates; at least 1000"):
        isotherm.noise(rates(999), interval=1.0)
    with pytest.raises(isotherm.NoiseError, match="never change"):
        isotherm.noise(np.ones(2000), interval=1.0)
    with pytest.raises(isotherm.NoiseError, match=r"rates\[7\] is NaN"):
        isotherm.noise(np.where(np.arange(2000) == 7, np.nan, rates(2000)), interval=1.0)
    with pytest.raises(isotherm.NoiseError, match="night: the longest stretch .* has 500 rows"):
        isotherm.noise(samples, end=50.0, recording="night")
    fast = samples.copy()
    for name in ("timestamp_ns", "interval_ns"):
        fast[name] //= 1000
    with pytest.raises(isotherm.NoiseError, match="1000.0 g0 at rest"):
        isotherm.noise(fast, table=isotherm.Table.load(night / "truth.toml"), kalibr=tmp_path / "imu.yaml")
    table = isotherm.Table.load(night / "truth.toml")
    few = samples[np.arange(len(samples)) % 20 > 0]
    assert isotherm.noise(few, table=table)["bridged"]["too_many"]
    with pytest.raises(isotherm.NoiseError, match="too many rows are missing for a Kalibr file"):
        isotherm.noise(few, table=table, kalibr=tmp_path / "imu.yaml")
    wrong = [
        {"interval": 0.0}, {"interval": 1.0, "table": isotherm.Table.load(night / "truth.toml")}, {"interval": 1.0, "temperature": [1.0]},
        {"temperature": [1.0]}, {"start": 5.0, "end": 5.0}, {"kalibr": tmp_path / "imu.yaml"},
    ]  # fmt: skip
    for arguments in wrong:
        with pytest.raises(ValueError):
            isotherm.noise(samples if "interval" not in arguments else rates(2000), **arguments)
    assert list(tmp_path.iterdir()) == []
