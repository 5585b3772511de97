"""Tables, recordings and the offline tools: their results equal those of the commands to the last bit."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import threading
import tomllib
import warnings
import zlib
from pathlib import Path
from typing import Any

import isotherm
import numpy as np
import pandas as pd
import pytest
from conftest import BINARY, CAMPAIGN, MEMS_TABLE, REPOSITORY, RUN, TABLE, WHOLE_CAMPAIGN, WHOLE_TABLE
from isotherm import _files, _isotherm, _offline


def command(*arguments: str | Path) -> str:
    return subprocess.run([BINARY, *arguments], check=True, capture_output=True, text=True, timeout=200).stdout


def without_what_differs(text: str) -> str:
    """A table file without the lines for the program and the time."""
    return re.sub(r"^(tool|time) = .*\n", "", text, flags=re.MULTILINE)


def test_records_and_flags_are_those_of_the_wire() -> None:
    def offsets(dtype: np.dtype[np.void]) -> dict[str, int]:
        return {name: field[1] for name, field in (dtype.fields or {}).items()}

    assert (isotherm.TRIAD.itemsize, isotherm.RAW_SAMPLE.itemsize, isotherm.INCREMENT.itemsize) == (96, 256, 104)
    assert offsets(isotherm.TRIAD) == {
        "positive_pulses": 0, "negative_pulses": 12, "head_temperature": 24, "board_temperature": 48, "head_lagged": 72,
    }  # fmt: skip
    assert offsets(isotherm.RAW_SAMPLE) == {
        "session": 0, "sequence": 8, "timestamp_ns": 16, "interval_ns": 24, "sent_ns": 32, "telemetry_ns": 40, "lag_ns": 48, "device": 56,
        "accelerometers": 64, "gyroscopes": 160,
    }  # fmt: skip
    assert offsets(isotherm.INCREMENT) == {
        "session": 0, "sequence": 8, "timestamp_ns": 16, "interval_ns": 24, "velocity_increment": 32, "angle_increment": 56, "table": 80,
        "flags": 88, "latency_ns": 96,
    }  # fmt: skip
    assert [(int(flag).bit_length() - 1, name) for flag in isotherm.Flags for name in isotherm.flag_names(flag)] == _isotherm.FLAGS
    assert isotherm.flag_names(0) == [] and isotherm.flag_names(1 << 28) == []
    assert isotherm.flag_names(1 << 26) == ["time-step"]
    assert isotherm.flag_names(1 << 27) == ["session"] and isotherm.Flags.LOST == 0xD000000
    # Every flag is in one mask, by its name.
    flags = isotherm.Flags
    masks = {"INVALID": flags.INVALID, "DEGRADED": flags.DEGRADED, "LOST": flags.LOST, "INFORMATION": flags.INFORMATION}

    def mask_of(name: str) -> str:
        if name in ("interval", "no-table") or name.endswith("-not-finite"):
            return "INVALID"
        return {"gap": "LOST", "time-step": "LOST", "session": "LOST", "late": "INFORMATION"}.get(name, "DEGRADED")

    for bit, name in _isotherm.FLAGS:
        assert [mask for mask, flags in masks.items() if flags & (1 << bit)] == [mask_of(name)], name
    assert isotherm.flag_names(isotherm.Flags.GAP | isotherm.Flags.A3_RATE | isotherm.Flags.G1_RATE) == ["a3-rate", "gap", "g1-rate"]
    # They go with arrays of every integer type.
    for dtype in (np.uint64, np.int64, object):
        flags = np.array([int(isotherm.Flags.GAP), int(isotherm.Flags.G3_RATE), 0], dtype)
        assert ((flags & isotherm.Flags.G3_RATE) != 0).tolist() == [False, True, False]
        assert (isotherm.Flags.GAP | flags).tolist() == [int(flag | isotherm.Flags.GAP) for flag in flags]
        assert (flags == isotherm.Flags.GAP).tolist() == [True, False, False]


def test_a_table(table: isotherm.Table) -> None:
    content = tomllib.loads(TABLE.read_text())
    assert table.imu == content["imu"]["id"] and table.gravity == content["imu"]["gravity"]
    assert isotherm.Table.parse(str(table)) == table and hash(isotherm.Table.parse(str(table))) == hash(table)
    assert f"{table.id:016x}" == table.digest.removeprefix("sha256:")[:16]
    assert table.digest in command("check", TABLE)
    temperature = np.linspace(1.0, 4.0, 7)
    for axis, given in zip(table.axes, content["axis"], strict=True):
        assert axis.name == given["name"]
        for polynomial, part in [(axis.bias, given["bias"]), (axis.negative_scale_factor, given["negative_scale_factor"])]:
            coefficients = [part[f"c{power}"] for power in range(len(polynomial.coefficients))]
            assert polynomial.coefficients.tolist() == coefficients
            assert polynomial.unit == part["unit"] and list(polynomial.range) == part["range"]
            right = []
            for u in temperature.tolist():
                x = (u - part.get("center", 0.0)) / part.get("scale", 1.0)
                value = coefficients[-1]
                for c in coefficients[-2::-1]:
                    value = value * x + c
                right.append(value)
            assert polynomial(temperature).tolist() == right
            assert [polynomial(u) for u in temperature.tolist()] == right
            assert polynomial(temperature.reshape(7, 1)[::2]).shape == (4, 1)
            assert polynomial(np.array([], np.float32)).shape == (0,)


def test_an_interval_that_is_not_nominal() -> None:
    mems = isotherm.Table.load(MEMS_TABLE)
    assert mems.nominal_interval_s == tomllib.loads(MEMS_TABLE.read_text())["imu"]["nominal_interval_s"] == 0.0025
    assert isotherm.Table.load(TABLE).nominal_interval_s is None
    nominal = math.floor(mems.nominal_interval_s * 1e9 + 0.5)

    def is_flagged(interval: int) -> bool:
        """As docs/table.md says."""
        m = min(max((interval + nominal // 2) // nominal, 1), 64)
        return abs(interval - m * nominal) * 100 > m * nominal

    intervals = [nominal * part // 1000 for part in (1, 989, 990, 1000, 1010, 1011, 1500, 1980, 2021, 64_000, 64_640, 64_641, 65_000, 202_000)]
    samples = np.zeros(len(intervals), isotherm.RAW_SAMPLE)
    samples["interval_ns"] = intervals
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        flags = isotherm.replay(mems, samples)["flags"]
    flag = np.uint64(isotherm.Flags.INTERVAL_NOT_NOMINAL)
    assert ((flags & flag) != 0).tolist() == [is_flagged(interval) for interval in intervals]
    assert any(map(is_flagged, intervals)) and not all(map(is_flagged, intervals))
    samples["interval_ns"] = 505_000_000
    with pytest.warns(UserWarning, match="scale factors of the table are of 0.0025 s"):
        isotherm.replay(mems, samples)


def test_all_faults_of_a_table_at_once(tmp_path: Path) -> None:
    broken = TABLE.read_text().replace("gravity = ", "gravity = 1").replace('out_of_range = "', 'out_of_range = "un')
    path = tmp_path / "broken.toml"
    path.write_text(broken)
    with pytest.raises(isotherm.TableError, match=re.escape(f"{path}:")) as refused:
        isotherm.Table.load(path)
    assert [key for _, key, _ in refused.value.faults] == ["imu.gravity", "temperature.out_of_range"]
    with pytest.raises(ValueError):
        isotherm.Table.parse("")
    with pytest.raises(FileNotFoundError):
        isotherm.Table.load(tmp_path / "none.toml")
    with pytest.raises(isotherm.TableError, match="not a regular file"):
        isotherm.Table.load(tmp_path)
    path.write_bytes(b"\xff")
    with pytest.raises(isotherm.TableError, match="UTF-8"):
        isotherm.Table.load(path)
    path.write_bytes(b"#" * (1 << 20) + b"\n")
    with pytest.raises(isotherm.TableError, match="over"):
        isotherm.Table.load(path)


def test_replay_is_the_command_byte_for_byte(table: isotherm.Table, recorded: isotherm.Records, tmp_path: Path) -> None:
    command("replay", "--table", TABLE, RUN, "-o", tmp_path / "command.csv")
    increments = isotherm.replay(table, recorded)
    isotherm.write_increments(tmp_path / "array.csv", increments)
    assert (tmp_path / "array.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()
    # Bit for bit, since the angles of a table without gyroscopes are NaN.
    assert isotherm.read_increments(tmp_path / "command.csv").tobytes() == increments.tobytes()
    # A data frame of the recording, as pandas reads it, with another index.
    frame = pd.read_csv(RUN, float_precision="round_trip").set_index(pd.RangeIndex(10, 10 + len(recorded)))
    result = isotherm.replay(table, frame)
    assert list(result.columns) == (tmp_path / "command.csv").read_text().partition("\n")[0].split(",")
    assert (result.index == frame.index).all()
    right = pd.read_csv(tmp_path / "command.csv", dtype={"table": str}, float_precision="round_trip")
    for column in result.columns:
        assert result[column].tolist() == right[column].tolist(), column


def test_a_whole_imu_in_arrays_files_and_frames(whole_table: isotherm.Table, whole: isotherm.Records, tmp_path: Path) -> None:
    right = isotherm.replay(whole_table, whole)
    assert np.isfinite(right["angle_increment"]).all() and not right["flags"].any()
    # The recording has no lagged temperature, so it is computed, here as in the command.
    path = tmp_path / "run.csv"
    isotherm.write_recording(path, whole)
    command("replay", "--table", WHOLE_TABLE, path, "-o", tmp_path / "command.csv")
    isotherm.write_increments(tmp_path / "array.csv", right)
    assert (tmp_path / "array.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()
    assert (isotherm.read_increments(tmp_path / "array.csv") == right).all()
    # A session begins soaked.
    twice = np.concatenate([whole[:200], whole[200:]])
    twice["session"][200:] = 1
    split = isotherm.replay(whole_table, twice)
    assert (split[:200] == right[:200]).all() and (split["velocity_increment"][200:] != right["velocity_increment"][200:]).any()
    assert (split[200:] == isotherm.replay(whole_table, twice[200:])).all()
    # With lagged temperature and a unit, every column is there; the samples' own lag is used.
    full = whole.copy()
    full["lag_ns"], full["device"], full["telemetry_ns"] = 240_000_000_000, isotherm.device("SN 42"), 1
    for triad in ("accelerometers", "gyroscopes"):
        full[triad]["head_lagged"] = full[triad]["head_temperature"] - 0.01
    isotherm.write_recording(path, full)
    assert (isotherm.read_recording(path) == full).all()
    frame = pd.read_csv(path, dtype={"device": str})
    assert len(frame.columns) == 3 + 24 + 7 + 2
    assert (isotherm.replay(whole_table, full) != right).all()
    result = isotherm.replay(whole_table, frame)
    assert result["g3_da"].tolist() == isotherm.replay(whole_table, full)["angle_increment"][:, 2].tolist()
    # Columns that belong together, and the number of the device, which is not a number in a frame.
    for column in ("g2_head", "lag_ns", "a1_head_lagged", "g3_head_lagged"):
        with pytest.raises(ValueError, match=f"missing columns: {column};"):
            isotherm.replay(whole_table, frame.drop(columns=column))
    for device in (1234567890123456, "46A7426EF29CC83", "+6a7426ef29cc83b"):
        with pytest.raises(TypeError, match="dtype={'device': str}"):
            isotherm.replay(whole_table, frame.assign(device=device))
    frame.loc[3, "device"] = None
    assert _offline.records(frame, isotherm.RAW_SAMPLE)["device"].tolist()[2:5] == [isotherm.device("SN 42"), 0, isotherm.device("SN 42")]


def test_a_table_of_a_whole_imu(whole_table: isotherm.Table, table: isotherm.Table) -> None:
    content = tomllib.loads(WHOLE_TABLE.read_text())
    assert whole_table.lag_s == content["lag"]["time_constant_s"] and whole_table.device == 0
    assert whole_table.gyroscope_alignment == content["gyroscope_alignment"]["matrix"]
    assert whole_table.gyroscopes is not None
    for axis, given in zip(whole_table.axes + whole_table.gyroscopes, content["axis"] + content["gyroscope"], strict=True):
        assert (axis.name, axis.transient) == (given["name"], given["bias"].get("transient", 0.0))
        assert axis.max_rate == given.get("max_rate")
        assert axis.bias.unit == given["bias"]["unit"]
        assert axis.positive_scale_factor.unit == given["positive_scale_factor"]["unit"]
        g = given.get("g_sensitivity")
        assert axis.g_sensitivity == (g and (g["a1"], g["a2"], g["a3"]))
    assert (table.gyroscopes, table.gyroscope_alignment, table.lag_s) == (None, None, None)


def test_a_recording_reads_back(recorded: isotherm.Records, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    isotherm.write_recording(path, recorded)
    # The temperature of gyroscopes that are not there is NaN, which equals nothing.
    assert isotherm.read_recording(path).tobytes() == recorded.tobytes()
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(isotherm.RecordingFault, match=rf"{path}:3: ") as fault:
        path.write_text(RUN.read_text().replace("\n1,", "\n0,", 1))
        isotherm.read_recording(path)
    assert fault.value.line == 3
    with pytest.raises(FileNotFoundError):
        isotherm.read_recording(tmp_path / "none.csv")
    with pytest.raises(isotherm.RecordingFault, match="missing columns"):
        isotherm.read_increments(RUN)
    # A failed write leaves no new file, and the old file stays.
    with pytest.raises(TypeError):
        isotherm.write_recording(path, np.zeros(3))
    with pytest.raises(FileNotFoundError):
        isotherm.write_recording(tmp_path / "no" / "where.csv", recorded)
    assert list(tmp_path.iterdir()) == [path]


def test_any_layout_gives_the_same(table: isotherm.Table, recorded: isotherm.Records) -> None:
    right = isotherm.replay(table, recorded).tobytes()

    def replayed(samples: Any) -> bytes:
        return isotherm.replay(table, samples).tobytes()

    spread = np.zeros(2 * len(recorded), isotherm.RAW_SAMPLE)
    spread[::2] = recorded
    assert replayed(spread[::2]) == right
    assert replayed(recorded[::-1][::-1]) == right
    assert replayed(recorded.astype(recorded.dtype.newbyteorder())) == right
    wide = np.dtype(
        [
            ("extra", np.int8),
            ("interval_ns", np.int64),
            *[d for d in isotherm.RAW_SAMPLE.descr if d[0] not in ("interval_ns", "session", "gyroscopes")],
        ]
    )
    other = np.zeros(len(recorded), wide)
    for name in isotherm.RAW_SAMPLE.names or ():
        if name not in ("session", "gyroscopes"):
            other[name] = recorded[name]
    assert replayed(other) == right
    assert isotherm.replay(table, recorded[:6].reshape(2, 3)).shape == (2, 3)
    assert isotherm.replay(table, recorded[0]).shape == ()
    assert isotherm.replay(table, recorded[:0]).shape == (0,)
    frame = pd.read_csv(RUN)
    assert len(isotherm.replay(table, frame[:0])) == 0
    assert (isotherm.replay(table, frame[::7])["a1_dv"] == isotherm.replay(table, frame)["a1_dv"][::7]).all()
    # Contiguous records are not copied.
    assert np.shares_memory(_offline.as_bytes(_offline.records(recorded, isotherm.RAW_SAMPLE)), recorded)


def test_what_is_no_sample_is_refused_by_name(table: isotherm.Table, recorded: isotherm.Records) -> None:
    for wrong in (None, [1, 2], 3.0, np.zeros(4), np.zeros(4, isotherm.INCREMENT), pd.Series([1.0])):
        with pytest.raises(TypeError):
            isotherm.replay(table, wrong)  # type: ignore[call-overload]
    frame = pd.read_csv(RUN)
    for column, value in [
        ("sequence", -1),
        ("a1_positive", 2**32),
        ("a2_negative", 0.5),
        ("interval_ns", np.nan),
        ("timestamp_ns", 1.9e19),
    ]:
        wrong = frame.astype({column: float if isinstance(value, float) else "int64"})
        wrong.loc[5, column] = value
        with pytest.raises(ValueError, match=f"(?s){column.rpartition('_')[2] if column[0] == 'a' else column}.*row 5"):
            isotherm.replay(table, wrong)
    with pytest.raises(ValueError, match="missing columns: a3_head"):
        isotherm.replay(table, frame.drop(columns="a3_head"))
    with pytest.raises(TypeError, match="head"):
        isotherm.replay(table, frame.astype({"a1_head": str}))
    flat = np.dtype([(name, np.float64) for name in isotherm.RAW_SAMPLE.names or ()])
    with pytest.raises(TypeError, match="accelerometers.positive_pulses.*gyroscopes.positive_pulses"):
        isotherm.replay(table, np.zeros(2, flat))
    part = [("gyroscopes", [field for field in isotherm.TRIAD.descr if field[0] != "negative_pulses"])]
    fields = [*[field for field in isotherm.RAW_SAMPLE.descr if field[0] != "gyroscopes"], *part]
    with pytest.raises(TypeError, match="missing fields: gyroscopes.negative_pulses$"):
        isotherm.replay(table, np.zeros(2, fields))
    with pytest.raises(TypeError):
        _isotherm.replay(table, recorded)  # type: ignore[arg-type]


def test_threads_replay_side_by_side(table: isotherm.Table, recorded: isotherm.Records) -> None:
    right = isotherm.replay(table, recorded).tobytes()
    results: list[bytes] = []
    threads = [threading.Thread(target=lambda: results.append(isotherm.replay(table, recorded).tobytes())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [right] * 4


def test_calibrate_is_the_command(tmp_path: Path) -> None:
    summary = json.loads(command("calibrate", "turntable", CAMPAIGN, "-o", tmp_path / "command.toml", "--json"))
    right = (tmp_path / "command.toml").read_text()
    calibration = isotherm.calibrate_turntable(CAMPAIGN)
    assert calibration.summary == summary and calibration.accuracy == summary["accuracy"]
    assert re.match(r"bias \+- [\d.]+ ug0, scale factor \+- [\d.]+ ppm over ", calibration.accuracy)
    assert without_what_differs(calibration.text) == without_what_differs(right)
    calibration.save(tmp_path / "python.toml", report=tmp_path / "python.html")
    assert isotherm.Table.load(tmp_path / "python.toml") == calibration.table
    assert "</svg>" in (tmp_path / "python.html").read_text()
    # The object's figures are those of the file.
    provenance = calibration.provenance
    assert provenance["dwells"] == len(calibration.dwells) == len(calibration.residuals)
    rms = np.sqrt((calibration.residuals**2).mean(axis=0))
    assert np.allclose(rms, provenance["residual_sd_g0"], rtol=1e-12, atol=0.0)
    for curve in provenance["curve"]:
        orders = calibration.orders[curve["axis"]][curve["quantity"]]
        assert (orders["selected"], orders["reason"]) == (curve["order"], curve["reason"])
        assert orders["orders"][curve["order"] - 1]["f"] > 100.0
    names = [message.partition("]: ")[0].removeprefix("[") for _, _, message in calibration.findings]
    assert names == [finding["name"] for finding in summary["findings"]]
    # A data frame and a mapping give the same table.
    samples = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    settings = tomllib.loads(CAMPAIGN.read_text())
    for other in (isotherm.calibrate_turntable(CAMPAIGN, samples), isotherm.calibrate_turntable(settings, samples)):
        assert other.table.digest == calibration.table.digest


def test_calibrate_a_whole_imu(tmp_path: Path) -> None:
    summary = json.loads(command("calibrate", "turntable", WHOLE_CAMPAIGN, "-o", tmp_path / "command.toml", "--json"))
    calibration = isotherm.calibrate_turntable(WHOLE_CAMPAIGN)
    assert without_what_differs(calibration.text) == without_what_differs((tmp_path / "command.toml").read_text())
    assert calibration.summary == summary and calibration.gyroscope_accuracy == summary["gyroscopes"]["accuracy"]
    assert re.match(r"bias \+- [\d.]+ deg/h, scale factor \+- [\d.]+ ppm over ", summary["gyroscopes"]["accuracy"])
    # The object's figures are those of the file.
    provenance, runs = calibration.provenance, calibration.gyroscope_runs
    assert len(runs) == len(calibration.gyroscope_residuals) == provenance["dwells"] + provenance["turns"] == 180 + 90
    assert {number for _, number, *_ in runs[180:]} == set(range(13, 19))
    walk = calibration.gyroscope_residuals / np.sqrt([[seconds] for *_, seconds in runs]) / 60.0
    assert np.allclose(np.sqrt((walk**2).mean(axis=0)), provenance["random_walk_deg_sqrt_h"], rtol=1e-9, atol=0.0)
    assert list(calibration.orders) == ["A1", "A2", "A3", "G1", "G2", "G3"]
    for curve in provenance["curve"]:
        assert calibration.orders[curve["axis"]][curve["quantity"]]["selected"] == curve["order"]
    # A data frame and a mapping give the same table; a campaign without turns has none of this.
    samples = pd.read_csv(WHOLE_CAMPAIGN.with_name("samples.csv"))
    settings = tomllib.loads(WHOLE_CAMPAIGN.read_text())
    assert isotherm.calibrate_turntable(settings, samples).table.digest == calibration.table.digest
    plain = {key: value for key, value in settings.items() if key not in ("turn", "latitude_deg")}
    alone = isotherm.calibrate_turntable(plain, samples[samples["position"] <= 12])
    assert (alone.gyroscope_accuracy, alone.gyroscope_runs, alone.gyroscope_residuals.shape) == (None, [], (0, 3))
    assert [message[:10] for _, _, message in alone.findings] == ["[no-turns]"] and list(alone.orders) == ["A1", "A2", "A3"]
    # Faults of turns.
    lost = samples.drop(samples.index[(samples["position"] == 13) & (samples["set_point_c"] == 20)][20])
    with pytest.raises(isotherm.CalibrationError, match=r"\[turn-gap\]: samples: row \d+: set point 20 degC, turn 13: rows are missing"):
        isotherm.calibrate_turntable(settings, lost)
    with pytest.raises(isotherm.CalibrationError, match="K\\+ of G1: no turn drives it positive"):
        isotherm.calibrate_turntable(settings, samples, exclude=[(20.0, 13)])
    with pytest.raises(isotherm.TableError, match="latitude_deg"):
        isotherm.calibrate_turntable({key: value for key, value in settings.items() if key != "latitude_deg"}, samples)
    # Samples of another device.
    marked = samples.assign(device=f"{isotherm.device('S/N 7'):016x}")
    assert isotherm.calibrate_turntable(settings | {"serial": "S/N 7"}, marked).findings == []
    with pytest.raises(isotherm.CalibrationError, match=r"\[other-device\]: samples: row 0: "):
        isotherm.calibrate_turntable(settings | {"serial": "S/N 8"}, marked)
    other = isotherm.calibrate_turntable(settings | {"serial": "S/N 8"}, marked, other_device=True)
    assert other.provenance["accepted"] == ["other-device"]


# Replaces both files until it is killed.
KILLED = """
from isotherm import _files
count = 0
while True:
    count += 1
    _files.write_together([("table", str(count)), ("report", str(count))])
    print(count, flush=True)
"""


def test_no_old_report_stays_beside_a_new_table(tmp_path: Path) -> None:
    for count in range(20):
        with subprocess.Popen([sys.executable, "-c", KILLED], cwd=tmp_path, stdout=subprocess.PIPE) as killed:
            assert killed.stdout is not None
            for _ in range(1 + count):
                killed.stdout.readline()
            killed.kill()
        left = {path.name: path.read_text() for path in tmp_path.iterdir() if not path.name.startswith(".")}
        assert left["table"] == left.get("report", left["table"])
        for hidden in tmp_path.glob(".isotherm-*"):
            hidden.unlink()
    # What fails leaves nothing, and all that was there.
    _files.write_together([(tmp_path / "table", "new"), (tmp_path / "report", "new")])
    for nowhere in (tmp_path / "nowhere" / "report", tmp_path):
        with pytest.raises(OSError):
            _files.write_together([(tmp_path / "table", "newer"), (nowhere, "newer")])
        assert sorted(path.name for path in tmp_path.iterdir()) == ["report", "table"]
        assert (tmp_path / "table").read_text() == (tmp_path / "report").read_text() == "new"


def test_calibrate_follows_its_options(tmp_path: Path) -> None:
    command("calibrate", "turntable", CAMPAIGN, "-o", tmp_path / "c.toml", "--order", "3", "--method", "two-stage", "--alignment", "--exclude=-25/3")
    calibration = isotherm.calibrate_turntable(CAMPAIGN, order=3, method="two-stage", alignment=True, exclude=[(-25.0, 3)])
    assert without_what_differs(calibration.text) == without_what_differs((tmp_path / "c.toml").read_text())
    assert np.array(calibration.table.alignment).shape == (3, 3)
    command("calibrate", "turntable", CAMPAIGN, "-o", tmp_path / "c.toml", "--order", "3", "--no-alignment")
    without = isotherm.calibrate_turntable(CAMPAIGN, order=3, alignment=False)
    assert without.table.alignment is None and without.table == isotherm.Table.load(tmp_path / "c.toml")
    # Without a choice the data decide.
    needed = isotherm.calibrate_turntable(CAMPAIGN, order=3)
    assert needed.summary["alignment_needed"] == needed.summary["alignment"] == (needed.table.alignment is not None)
    assert without.summary["alignment_needed"] == needed.summary["alignment_needed"]
    with pytest.raises(isotherm.CalibrationError, match="leave out"):
        isotherm.calibrate_turntable(CAMPAIGN, exclude=[(99.0, 1)])
    with pytest.raises(ValueError, match="order"):
        isotherm.calibrate_turntable(CAMPAIGN, order=8)
    with pytest.raises(ValueError, match="method"):
        isotherm.calibrate_turntable(CAMPAIGN, method="other")  # type: ignore[arg-type]


def test_a_campaign_reports_its_faults(tmp_path: Path) -> None:
    settings = tomllib.loads(CAMPAIGN.read_text())
    samples = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    with pytest.raises(isotherm.TableError, match="gravity_local"):
        isotherm.calibrate_turntable(settings | {"gravity_local": 1.0}, samples)
    with pytest.raises(TypeError, match="dict"):
        isotherm.calibrate_turntable(settings | {"soak_s": {}}, samples)
    with pytest.raises(isotherm.RecordingFault, match="samples: row 7: .*no such position") as fault:
        wrong = samples.copy()
        wrong.loc[7, "position"] = 77
        isotherm.calibrate_turntable(CAMPAIGN, wrong)
    assert fault.value.line == 7
    with pytest.raises(isotherm.RecordingFault, match="samples: row 3: .*a2_board is NaN"):
        wrong = samples.copy()
        wrong.loc[3, "a2_board"] = np.nan
        isotherm.calibrate_turntable(CAMPAIGN, wrong)
    with pytest.raises(isotherm.CalibrationError) as refused:
        isotherm.calibrate_turntable(CAMPAIGN, samples[samples["position"] != 2])
    assert refused.value.findings or "position" in str(refused.value)
    with pytest.raises(isotherm.CalibrationError, match="no rows"):
        isotherm.calibrate_turntable(CAMPAIGN, samples[:0])
    with pytest.raises(FileNotFoundError):
        isotherm.calibrate_turntable(CAMPAIGN, tmp_path / "none.csv")
    with pytest.raises(isotherm.CalibrationError):
        isotherm.calibrate_turntable(settings | {"position": settings["position"][:3]}, samples)


def test_faults_are_accepted_by_name() -> None:
    samples = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    samples["interval_ns"] = 9_000_000_000
    with pytest.raises(isotherm.CalibrationError, match=r"^fault \[interval\]: ") as refused:
        isotherm.calibrate_turntable(CAMPAIGN, samples)
    # A finding is the line that the command prints.
    severity, _, message = refused.value.findings[0]
    assert f"{severity} {message}" == str(refused.value).splitlines()[0]
    for accept in (["interval"], "interval"):
        accepted = isotherm.calibrate_turntable(CAMPAIGN, samples, accept=accept)
        assert 'accepted = ["interval"]' in accepted.text and accepted.summary["accepted"] == ["interval"]
    severity, _, message = accepted.findings[0]
    assert severity == "warning" and message.startswith("[interval]: ") and message.endswith("; accepted")
    with pytest.raises(isotherm.CalibrationError):
        isotherm.calibrate_turntable(CAMPAIGN, samples[samples.index % 10 != 7], strict=True)
    # The mistake that explains the others comes first, and once.
    exchanged = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    exchanged["position"] = exchanged["position"].replace({3: 9, 9: 3})
    with pytest.raises(isotherm.CalibrationError, match=r"^fault \[positions-exchanged\]: positions 3 and 9 ") as refused:
        isotherm.calibrate_turntable(CAMPAIGN, exchanged)
    diagnoses = [place for place, finding in enumerate(refused.value.findings) if "[positions-exchanged]" in finding[2]]
    assert diagnoses == [0] and len(refused.value.findings) > 10
    with pytest.raises(ValueError, match="give the name of a finding"):
        isotherm.calibrate_turntable(CAMPAIGN, accept=["other"])


def test_rows_of_a_moving_table_count_for_no_dwell() -> None:
    samples = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    array = _offline.records(samples, isotherm.CAMPAIGN)
    assert array.dtype == isotherm.CAMPAIGN and isotherm.CAMPAIGN.itemsize == 272
    moving = samples.astype({"position": float})
    moving.loc[samples.index[:30], "position"] = np.nan
    assert (_offline.records(moving, isotherm.CAMPAIGN)["position"][:30] == -1).all()
    assert isotherm.calibrate_turntable(CAMPAIGN, array).table == isotherm.calibrate_turntable(CAMPAIGN).table


def test_regress_is_the_command(tmp_path: Path) -> None:
    path = REPOSITORY / "examples/cubic.csv"
    frame = pd.read_csv(path)
    right = json.loads(command("regress", path, "--x", "x", "--y", "y", "--json"))
    got = isotherm.regress(frame["x"], frame["y"])
    for key in set(right) - {"x", "y", "diagnostics", "warnings"}:
        assert got[key] == right[key], key
    assert got["diagnostics"]["lag1"] == right["diagnostics"]["lag1"]
    frame["w"] = 1.0 + frame.index % 3
    frame.to_csv(tmp_path / "weighted.csv", index=False)
    right = json.loads(
        command(
            "regress",
            tmp_path / "weighted.csv",
            "--x",
            "x",
            "--y",
            "y",
            "--weights",
            "w",
            "--max-order",
            "4",
            "--min-effect",
            "0.5",
            "--json",
        )
    )
    got = isotherm.regress(frame["x"].to_numpy(), frame["y"].tolist(), weights=frame["w"], max_order=4, min_effect=0.5)
    assert got["orders"] == right["orders"] and got["reason"] == right["reason"]
    # A further --x of the command is a linear column here.
    frame["step"] = 1.0 * (frame.index % 4 > 1)
    frame.to_csv(tmp_path / "columns.csv", index=False)
    right = json.loads(command("regress", tmp_path / "columns.csv", "--x", "x", "--x", "step", "--y", "y", "--json"))
    got = isotherm.regress(frame["x"], frame["y"], linear={"step": frame["step"]})
    assert got["orders"] == right["orders"] and got["linear"] == right["linear"] == ["step"]
    # A perfect fit has no F value.
    assert isotherm.regress([1, 2, 3, 4], [1, 2, 3, 4], max_order=1)["orders"][0]["f"] is None
    for x, y, options, match in [
        ([1, 2], [1], {}, "one length"),
        ([1, 2, 3], [1, 2, np.nan], {}, r"y\[2\]"),
        ([1, 1, 1], [1, 2, 3], {"max_order": 2}, "different values"),
        ([1, 2, 3], [1, 2, 3], {"max_order": 16}, "max_order"),
        ([1, 2, 3], [1, 2, 3], {"weights": [1, 0, 1]}, r"weights\[1\]"),
        ([1, 2, 3, 5], [1, 2, 3, 4], {"linear": {"u": [0, np.inf, 1, 1]}, "max_order": 1}, r"u\[1\]"),
        ([1, 2, 3, 5], [1, 2, 3, 4], {"linear": {"u": [0, 1]}, "max_order": 1}, "u"),
        ([1, 2, 3, 5], [1, 2, 3, 4], {"linear": {"twice": [2, 4, 6, 10]}, "max_order": 1}, "twice"),
        ([1, 2, 3], [1, 2, 3], {"min_effect": -1.0}, "min_effect"),
    ]:
        with pytest.raises(ValueError, match=match):
            isotherm.regress(x, y, **options)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with table.toml and run.csv, a run at rest at this attitude while the temperature runs."""
    folder = tmp_path_factory.mktemp("still")
    command("calibrate", "turntable", CAMPAIGN, "-o", folder / "table.toml")
    command("simulate", "run", "-o", folder, "--interval", "1")
    return folder


ATTITUDE = (0.6, -0.48, 0.64)


def verify(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """The command with the run and its attitude."""
    arguments = ["verify", "--table", folder / "table.toml", folder / "run.csv", "--attitude", "0.6,-0.48,0.64", *options]
    return subprocess.run([BINARY, *arguments], capture_output=True, text=True, timeout=200)


def test_verify_is_the_command(still: Path, tmp_path: Path) -> None:
    text = verify(still).stdout
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    stability = isotherm.verify(table, samples, attitude=ATTITUDE)
    for axis in range(3):
        row = next(line.split() for line in text.splitlines() if line.strip().startswith(f"A{axis + 1} "))
        figures = (stability.sd_before, stability.rms_before, stability.sd_after, stability.rms_after)
        assert [f"{figure[axis] * 1e6:.3f}" for figure in figures] + [f"{stability.factor[axis]:.2f}"] == row[1:]
    windows = stability.windows
    assert windows.dtype == isotherm.WINDOW and f"of {len(windows)} windows" in text
    off = windows["after"][windows["counts"]] - stability.specific_force
    assert np.allclose(off.std(axis=0, ddof=1), stability.sd_after, rtol=1e-9)
    assert stability.stated and stability.warning is None and stability.verdict["length"] is not None
    assert text.splitlines()[0] == f"all {len(windows)} windows are judged"
    assert stability.verdict["windows_left_out"]["count"] == 0
    # The run only heats.
    assert stability.verdict["axes"][0]["hysteresis"] == {"static_g0": None, "full_g0": None, "shared_bins": None, "not_judged": "only one direction"}
    stability.report(tmp_path / "verify.html", require=10.0)
    assert "</svg>" in (tmp_path / "verify.html").read_text()
    assert min(isotherm.verify(table, pd.read_csv(still / "run.csv"), window=20.0).factor) > 10.0
    with pytest.raises(isotherm.StabilityError, match="windows"):
        isotherm.verify(table, samples[:5])
    for options in ({"window": 0.0}, {"window": np.nan}, {"attitude": (0.0, 0.0, 0.0)}, {"attitude": (1.0, 0.0)}, {"gravity_local": 1.0}, {"angles": (1.0,)}):
        with pytest.raises(ValueError):
            isotherm.verify(table, samples, **options)  # type: ignore[arg-type]


def test_angles_need_earths_rate_and_other_units_are_refused(still: Path, tmp_path: Path) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    with pytest.raises(ValueError, match="earth_rate_deg_h"):
        isotherm.verify(table, samples, angles=(50.0, 130.0))
    assert "gyroscopes" not in isotherm.verify(table, samples).verdict
    # The provenance is below the table, and not part of its digest. A level base in the north, at the attitude of the
    # angles.
    earth = (still / "table.toml").read_text().replace("[provenance]", "[provenance]\nearth_rate_deg_h = [9.1, -6.9, 9.6]")
    (tmp_path / "earth.toml").write_text(earth)
    turned = isotherm.verify(isotherm.Table.load(tmp_path / "earth.toml"), samples, angles=(50.208, 128.66))
    assert turned.stated and np.allclose(turned.specific_force, ATTITUDE, atol=1e-3)
    with pytest.raises(ValueError, match="do not agree"):
        isotherm.verify(isotherm.Table.load(tmp_path / "earth.toml"), samples, angles=(0.0, 0.0), attitude=ATTITUDE)
    bare = str(table).replace("gravity =", 'serial = "SN 1"\ngravity =', 1)
    unit = isotherm.Table.parse("\n".join(line for line in bare.splitlines() if not line.startswith("digest")))
    other = samples.copy()
    other["device"] = 1
    with pytest.raises(isotherm.StabilityError, match="another device"):
        isotherm.verify(unit, other)
    assert isotherm.verify(unit, other, other_device=True).factor == isotherm.verify(unit, samples).factor


def test_the_verdict_is_that_of_the_command(still: Path) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    stability = isotherm.verify(table, samples, attitude=ATTITUDE)
    assert stability.verdict == json.loads(verify(still, "--json").stdout)
    gravity = tomllib.loads(CAMPAIGN.read_text())["gravity_local"]
    assert table.gravity_local == stability.verdict["gravity_local_m_s2"] == gravity
    assert stability.verdict["gravity_source"] == "provenance" and stability.verdict["required"] is None
    # A gravity that is 1000e-6 too large shows in the length.
    stated = isotherm.verify(table, samples, attitude=ATTITUDE, gravity_local=gravity * 1.001)
    constants = [each.verdict["length"]["constant_g0"]["value"] for each in (stability, stated)]
    assert constants[1] - constants[0] == pytest.approx(-0.001 * gravity / table.gravity, rel=1e-6)
    assert stated.verdict["gravity_source"] == "stated"
    # Nobody says the gravity, and nobody the attitude: neither is judged.
    bare = isotherm.Table.parse(str(table))
    unknown = isotherm.verify(bare, samples)
    assert bare.gravity_local is None and unknown.verdict["length"] is None
    assert [axis["constant_g0"] for axis in unknown.verdict["axes"]] == [None] * 3
    assert [met for _, met, _ in unknown.judge("bias=1g0,scale=1%,level=1deg,factor=2")] == [True, False, False, False]
    # With only the attitude, the level is judged.
    level = isotherm.verify(bare, samples, attitude=ATTITUDE)
    assert [met for _, met, _ in level.judge("bias=1g0,scale=1%,level=1deg")] == [False, False, True]
    assert "without local gravity only variation and level" in level.verdict["not_judged"]


def test_a_run_that_is_judged_in_a_part_only_meets_no_requirement(still: Path) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    samples["accelerometers"]["head_temperature"][: len(samples) // 2, 0] = np.nan
    stability = isotherm.verify(table, samples, attitude=ATTITUDE)
    assert stability.warning is not None and "windows are not at the attitude" in stability.warning
    assert stability.verdict["largest"] is None and stability.verdict["not_the_whole_run"] == stability.warning
    assert [(bound, met) for bound, met, _ in stability.judge("bias=1g0")] == [("bias", False), ("whole run", False)]
    with pytest.raises(isotherm.StabilityError, match="windows are not at the attitude"):
        stability.check("bias=1g0")


@pytest.mark.parametrize("require", ["bias=20ug0,scale=50ppm,level=5arcsec", "bias=0.001ug0,factor=10", "10", "1e9"])
def test_a_requirement_is_judged_as_by_the_command(still: Path, tmp_path: Path, require: str) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    stability = isotherm.verify(table, samples, attitude=ATTITUDE, recording=str(still / "run.csv"))
    done = verify(still, "--json", "--require", require)
    judgements = [dict(zip(("bound", "met", "message"), judgement, strict=True)) for judgement in stability.judge(require)]
    found = json.loads(done.stdout)["judgements"]
    assert judgements == [{key: each[key] for key in ("bound", "met", "message")} for each in found]
    assert all((each["remedy"] is None) == each["met"] for each in found)
    stability.report(tmp_path / "verify.html", require=require)
    missed = "Requirement missed" in (tmp_path / "verify.html").read_text()
    if all(met for _, met, _ in stability.judge(require)):
        assert done.returncode == 0 and not missed
        stability.check(require)
    else:
        assert done.returncode == 1 and missed
        with pytest.raises(isotherm.StabilityError) as refused:
            stability.check(require)
        assert str(refused.value) in done.stderr
    if "=" not in require:
        assert stability.judge(float(require)) == stability.judge(np.float64(require)) == stability.judge(require)


def test_no_bound_is_met_over_a_hole_unless_that_is_accepted(still: Path) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    ends = np.concatenate([samples[: len(samples) // 8], samples[-(len(samples) // 8) :]])
    stability = isotherm.verify(table, ends, attitude=ATTITUDE)
    hole = stability.verdict["covered"]["hole"]
    ((bound, met, message),) = stability.judge("bias=1mg0")
    assert (bound, met) == ("bias", False) and message.endswith(f"not shown over {hole}")
    accepted = isotherm.verify(table, ends, attitude=ATTITUDE, accept="not-covered")
    ((bound, met, message),) = accepted.judge("bias=1mg0")
    assert (bound, met) == ("bias", True) and message.endswith(f"met; not shown over {hole}")
    with pytest.raises(ValueError, match="accept: give the name of a finding"):
        isotherm.verify(table, ends, attitude=ATTITUDE, accept=["covered"])


def test_what_is_no_requirement_is_refused(still: Path, tmp_path: Path) -> None:
    table, samples = isotherm.Table.load(still / "table.toml"), isotherm.read_recording(still / "run.csv")
    stability = isotherm.verify(table, samples, attitude=ATTITUDE)
    for wrong in ("", "bias=20", "tilt=3deg", "bias=20ug0,bias=20ug0", -1.0, 0.0, np.nan, np.inf):
        for call in (stability.judge, stability.check, lambda wrong: stability.report(tmp_path / "no.html", require=wrong)):
            with pytest.raises(ValueError, match="require: "):
                call(wrong)
    with pytest.raises(TypeError):
        stability.judge(None)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []
    # An IMU with other scale factors meets no requirement, as in the command.
    path = tmp_path / "other.csv"
    samples["accelerometers"]["positive_pulses"] //= 2
    isotherm.write_recording(path, samples)
    other = isotherm.verify(table, samples, recording=str(path))
    assert other.warning is not None
    done = subprocess.run([BINARY, "verify", "--table", still / "table.toml", path, "--require", "0.001"], capture_output=True, text=True, timeout=200)
    with pytest.raises(isotherm.StabilityError, match="another IMU") as refused:
        other.check(0.001)
    assert done.returncode == 1 and str(refused.value) in done.stderr


def test_a_campaign_mapping_becomes_toml() -> None:
    settings = {
        "imu": 'a"\n\x7f\u00e9',
        "n": 3,
        "f": np.float64(1e-7),
        "position": [{"number": 1, "specific_force": np.array([0.0, 0.0, 1.0])}],
        "turn": [{"number": 2, "axis": [0, 0, 1]}, {"number": 3, "label": None}],
    }
    assert tomllib.loads(_offline.campaign_toml(settings)) == {
        "samples": "samples", "imu": 'a"\n\x7f\u00e9', "n": 3, "f": 1e-7, "position": [{"number": 1, "specific_force": [0.0, 0.0, 1.0]}],
        "turn": [{"number": 2, "axis": [0, 0, 1]}, {"number": 3}],
    }  # fmt: skip


COMPARE = REPOSITORY / "calibration/fit/tests/data/any_lab/compare"


def test_compare_is_the_command(tmp_path: Path) -> None:
    old, new = COMPARE / "2023.toml", COMPARE / "2024.toml"
    found = isotherm.compare(old, new)
    document = json.loads(command("compare", old, new, "--json"))
    assert found.summary == document
    assert found.changed == document["changed"] and found.changed[0] == "A1 bias"
    assert str(found) == command("compare", old, new)
    assert repr(found).startswith("Comparison('Changed by more than the errors: A1 bias, ")
    # Tables keep the errors of their files.
    tables = isotherm.compare(isotherm.Table.load(old), isotherm.Table.parse(new.read_text()))
    assert tables.summary["curves"] == document["curves"] and tables.summary["old"] == "table 1"
    assert found.judge("bias=2ug0")[0][:2] == ("A1 bias", "beyond")
    assert [verdict for _, verdict, _ in found.judge("bias=4.2ug0")] == ["undecided"] * 3
    found.check("bias=5ug0,scale=9ppm,alignment=1urad")
    with pytest.raises(isotherm.ComparisonError, match="2024.toml: the requirement is not met:\n  A1 bias: 4.258, with"):
        found.check("bias=2ug0")
    with pytest.raises(ValueError, match='require: bias is "2"; give a number with a unit: ug0'):
        found.check("bias=2")
    found.report(tmp_path / "r.html", require="bias=2ug0")
    assert "Requirement missed" in (tmp_path / "r.html").read_text()
    years = isotherm.compare(*(COMPARE / f"{year}.toml" for year in (2026, 2023, 2025, 2024)))
    trend = years.summary["trends"][0]
    assert abs(trend["slope_in_unit_per_year"] - 3.99594) < 1e-5 and trend["unit"] == "ug0"
    with pytest.raises(isotherm.ComparisonError, match="tables of two IMUs: imu-a, imu-b; give those of one, or"):
        isotherm.compare(old, COMPARE / "other_imu.toml")
    assert isotherm.compare(old, COMPARE / "other_imu.toml", other_device=True).summary["tables"][1]["imu"] == "imu-b"
    # A calibration compares as the file that it saves, here to itself.
    calibration = isotherm.calibrate_turntable(CAMPAIGN)
    calibration.save(tmp_path / "table.toml")
    same = isotherm.compare(calibration, tmp_path / "table.toml")
    assert same.changed == [] and same.summary["errors_known"]


def test_batch_of_tables(tmp_path: Path) -> None:
    text = (COMPARE / "2023.toml").read_text()
    # Biases of five IMUs, the last one far off.
    biases = [0.0, 3.0, -2.0, 1.0, -1.5, 4000.0]
    units = [
        isotherm.Table.parse(text.replace('"imu-a"', f'"imu-{index}"').replace("c0 = 792.7", f"c0 = {792.7 + bias}"))
        for index, bias in enumerate(biases)
    ]
    found = isotherm.batch(units)
    assert found.devices == [f"imu-{index}" for index in range(6)]
    assert found.stand_outs is not None and {unit for unit, _, _ in found.stand_outs} == {"imu-5"}
    quantities = {quantity["name"]: quantity for quantity in found.summary["quantities"]}
    values = quantities["A1 bias at 2.5000"]["values_in_unit"]
    assert np.allclose(np.array(values) - values[0], np.array(biases) - biases[0], atol=0.1)
    assert found.summary["gravity_m_s2"] == 9.8015
    assert "imu-5 stands out: A1 bias at " in str(found)
    found.report(tmp_path / "batch.html")
    assert "imu-5 stands out" in (tmp_path / "batch.html").read_text()
    assert isotherm.batch(units[:4]).stand_outs is None
    with pytest.raises(isotherm.ComparisonError, match="two tables are of imu-1"):
        isotherm.batch([*units, units[1]])


def test_calibrate_one_imu_of_a_batch(tmp_path: Path) -> None:
    text = CAMPAIGN.read_text().replace('imu = "imu-paper"\nsamples = "samples.csv"', 'imus = [{ id = "imu-a" }, { id = "imu-b" }]\nsamples = "{imu}.csv"')
    (tmp_path / "campaign.toml").write_text(text)
    for name in ("imu-a", "imu-b"):
        (tmp_path / f"{name}.csv").write_bytes(CAMPAIGN.with_name("samples.csv").read_bytes())
    calibration = isotherm.calibrate_turntable(tmp_path / "campaign.toml", imu="imu-b")
    assert calibration.table.imu == "imu-b"
    with pytest.raises(ValueError, match="campaign.toml: it has several IMUs; choose one of imu-a, imu-b"):
        isotherm.calibrate_turntable(tmp_path / "campaign.toml")
    # As a mapping; the command makes the same table.
    settings = tomllib.loads(text)
    again = isotherm.calibrate_turntable(settings, tmp_path / "imu-b.csv", imu="imu-b")
    assert again.table == calibration.table
    command("calibrate", "turntable", tmp_path / "campaign.toml", "-o", tmp_path / "{imu}.toml", "--imu", "imu-b")
    assert without_what_differs((tmp_path / "imu-b.toml").read_text()) == without_what_differs(calibration.text)


def test_a_damaged_row_is_left_out_with_a_warning(tmp_path: Path) -> None:
    samples = isotherm.read_recording(RUN)
    lines = RUN.read_text().splitlines(keepends=True)
    damaged = tmp_path / "damaged.csv"
    damaged.write_text("".join([*lines[:5], lines[5].replace(",", "z,", 2), *lines[6:]]))
    with pytest.warns(UserWarning, match="1 damaged place is left out; the first is line 6, behind row 4"):
        left = isotherm.read_recording(damaged)
    assert left.tobytes() == np.delete(samples, 4).tobytes()
    damaged.write_text("")
    with pytest.raises(isotherm.RecordingFault, match="the file is empty"):
        isotherm.read_recording(damaged)
