"""Data frames of pandas, tables of Arrow and polars, and recordings of every format as arrays."""

import os
import subprocess
import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import isotherm
from conftest import BINARY, REPOSITORY

RUN = REPOSITORY / "tests/data/run.csv"
TABLE = REPOSITORY / "tests/data/imu-a.toml"
KINDS = {"RAW_SAMPLE": isotherm.RAW_SAMPLE, "CAMPAIGN": isotherm.CAMPAIGN, "INCREMENT": isotherm.INCREMENT}
G = 9.80665


def any_bytes(dtype: np.dtype[np.void], rows: int = 200) -> isotherm.Records:
    """Records of random bytes, so also of NaNs of every kind. The times are those of a clock."""
    generator = np.random.default_rng(20)
    array = np.frombuffer(generator.bytes(rows * dtype.itemsize), dtype).copy()
    array["timestamp_ns"] >>= np.uint64(4)
    return array


@pytest.mark.parametrize("kind", KINDS)
def test_frames_and_tables_give_the_same_bytes_back(kind: str) -> None:
    dtype = KINDS[kind]
    for array in (any_bytes(dtype), np.zeros(3, dtype), np.zeros(0, dtype)):
        for frame in (isotherm.to_frame(array), isotherm.to_frame(array, epoch="2026-05-01")):
            back = isotherm.from_frame(frame)
            assert back.dtype == dtype and back.tobytes() == array.tobytes()
        table = isotherm.to_arrow(array)
        assert isinstance(table, pa.Table) and table.column_names == list(isotherm.to_frame(array).columns)
        assert isotherm.from_arrow(table).tobytes() == array.tobytes()
        of_polars = pl.from_arrow(table)
        assert isotherm.from_arrow(of_polars).tobytes() == array.tobytes()
        assert isotherm.from_arrow(table, dtype).tobytes() == array.tobytes()


def test_frames_have_the_columns_of_a_recording_and_an_index_by_time(tmp_path: Path) -> None:
    samples = isotherm.read_recording(RUN)
    frame = isotherm.to_frame(samples)
    read = pd.read_csv(RUN)
    columns = [name for name in read.columns if name in frame.columns]
    assert len(columns) == len(read.columns)
    assert (frame[columns].reset_index(drop=True) == read[columns]).all(axis=None)
    assert isinstance(frame.index, pd.TimedeltaIndex) and frame.index.name == "time"
    assert (frame.index.to_numpy().astype(np.uint64) == samples["timestamp_ns"]).all()
    assert frame.loc[frame.index[3] :, "sequence"].iloc[0] == samples["sequence"][3]
    dated = isotherm.to_frame(samples, epoch=datetime(2026, 5, 1, tzinfo=timezone.utc))
    assert isinstance(dated.index, pd.DatetimeIndex)
    assert dated.index[0] == pd.Timestamp("2026-05-01", tz="UTC") + frame.index[0]

    table = isotherm.Table.load(TABLE)
    increments = isotherm.replay(table, samples)
    replayed = isotherm.replay(table, frame)
    assert (replayed.index == frame.index).all()
    assert isotherm.from_frame(replayed)["velocity_increment"].tobytes() == increments["velocity_increment"].tobytes()
    increments["flags"][0] = isotherm.Flags.LATE | isotherm.Flags.A1_RATE | 1 << 63
    shown = isotherm.to_frame(increments)
    assert shown["flags"].iloc[0] == "a1-rate" and shown["delivery"].iloc[0] == "late"
    assert (shown["flag_bits"].to_numpy() == increments["flags"]).all()
    assert isotherm.from_frame(shown).tobytes() == increments.tobytes()
    isotherm.write_increments(tmp_path / "frame.csv", isotherm.to_frame(increments))
    isotherm.write_increments(tmp_path / "array.csv", increments)
    assert (tmp_path / "frame.csv").read_bytes() == (tmp_path / "array.csv").read_bytes()


def test_a_table_of_arrow_or_polars_is_taken_as_a_frame(tmp_path: Path) -> None:
    samples = isotherm.read_recording(RUN)
    table, arrow = isotherm.Table.load(TABLE), isotherm.to_arrow(samples)
    right = isotherm.replay(table, samples)
    assert isotherm.replay(table, arrow).tobytes() == right.tobytes()
    assert isotherm.replay(table, pl.read_csv(RUN)).tobytes() == right.tobytes()
    # As the message says that refuses Parquet.
    pq.write_table(arrow, tmp_path / "arrow.parquet")
    with pytest.raises(isotherm.RecordingFault, match="from_arrow"):
        isotherm.read_recording(tmp_path / "arrow.parquet")
    isotherm.write_recording(tmp_path / "arrow.mcap", isotherm.from_arrow(pq.read_table(tmp_path / "arrow.parquet")))
    assert isotherm.read_recording(tmp_path / "arrow.mcap").tobytes() == samples.tobytes()
    missing = pa.table({"sequence": [1, None], "timestamp_ns": [1, 2], "interval_ns": [1, 1]})
    with pytest.raises(ValueError, match="missing columns: a1_positive"):
        isotherm.from_arrow(missing)
    broken = arrow.set_column(arrow.column_names.index("sequence"), "sequence", pa.array([None, *range(1, len(samples))], pa.uint64()))
    with pytest.raises(ValueError, match="sequence: row 0 is nan, give a whole number"):
        isotherm.from_arrow(broken)


def test_what_is_no_frame_or_no_array_says_so() -> None:
    samples = isotherm.read_recording(RUN)[:4]
    with pytest.raises(TypeError, match="give a data frame of pandas, not Table; from_arrow"):
        isotherm.from_frame(isotherm.to_arrow(samples))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="__arrow_c_stream__, not list"):
        isotherm.from_arrow([])
    with pytest.raises(TypeError, match="RAW_SAMPLE, CAMPAIGN or INCREMENT, not float64"):
        isotherm.to_frame(np.zeros(3))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="has the shape \\(2, 2\\)"):
        isotherm.to_frame(samples.reshape(2, 2))
    with pytest.raises(ValueError, match="dtype is"):
        isotherm.from_frame(isotherm.to_frame(samples), isotherm.TRIAD)
    late = samples.copy()
    late["timestamp_ns"][2] = 2**63
    with pytest.raises(ValueError, match="timestamp_ns: row 2 is 9223372036854775808.*to_arrow"):
        isotherm.to_frame(late)
    assert isotherm.from_arrow(isotherm.to_arrow(late)).tobytes() == late.tobytes()
    flags = isotherm.to_frame(np.zeros(1, isotherm.INCREMENT)).drop(columns="flag_bits")
    flags["flags"] = "lat"
    with pytest.raises(ValueError, match="flags has 'lat', give names of flags"):
        isotherm.from_frame(flags)


@pytest.mark.parametrize(("package", "call"), [("pandas", "to_frame"), ("pyarrow", "to_arrow")])
def test_without_the_package_the_rest_works_and_the_call_says_what_to_install(package: str, call: str) -> None:
    extra = {"pandas": "pandas", "pyarrow": "arrow"}[package]
    program = f"""
import sys
sys.modules["pandas"] = sys.modules["pyarrow"] = None
import isotherm
samples = isotherm.read_recording({str(RUN)!r})
isotherm.replay(isotherm.Table.load({str(TABLE)!r}), samples)
try:
    isotherm.{call}(samples)
except ImportError as error:
    assert error.name == {package!r} and "pip install 'isotherm[{extra}]'" in str(error), error
else:
    raise SystemExit("no error")
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def readings(**columns: Any) -> pd.DataFrame:
    count = len(next(iter(columns.values())))
    return pd.DataFrame(columns | {"ax": np.linspace(0.0, 0.2, count), "ay": 0.5, "az": G})


def mapping(**time: Any) -> dict[str, Any]:
    return {
        "time": time,
        "accelerometer": {"columns": ["ax", "ay", "az"], "kind": "reading", "unit": "m/s2", "resolution": 0.001},
        "temperature": {"constant": 25.0},
    }


def test_convert_takes_the_times_of_datetime_numpy_and_pandas() -> None:
    ns = 1_777_593_600_000_000_000 + 10_000_000 * np.arange(50)
    right = isotherm.convert(readings(t=ns), mapping(column="t", unit="ns"))
    assert (right["timestamp_ns"] == ns).all() and (right["interval_ns"] == 10_000_000).all()
    stamps = pd.DatetimeIndex(ns, tz="UTC")
    as_times: dict[str, Any] = {
        "datetime64[ns]": ns.astype("datetime64[ns]"),
        "datetime64[us]": ns.astype("datetime64[ns]").astype("datetime64[us]"),
        "UTC": stamps,
        "another zone": stamps.tz_convert("Asia/Tokyo"),
        "without a zone": stamps.tz_localize(None),
        "Timestamps": pd.Series(list(stamps), dtype=object),
        "datetimes": pd.Series([stamp.to_pydatetime() for stamp in stamps.tz_convert("America/New_York")], dtype=object),
        "Arrow": pd.Series(stamps).astype(pd.ArrowDtype(pa.timestamp("ns", "UTC"))),
    }
    for name, times in as_times.items():
        for time in ({"column": "t"}, {"column": "t", "unit": "ns"}):
            found = isotherm.convert(readings(t=times), mapping(**time))
            assert found.tobytes() == right.tobytes(), name
    by_index = readings(x=ns).set_index(stamps)
    for index in ("when", None):
        by_index.index.name = index
        found = isotherm.convert(by_index, mapping(column=index or "time"))
        assert found.tobytes() == right.tobytes()
    arrays = {name: by_index[name].to_numpy() for name in ("ax", "ay", "az")} | {"t": stamps}
    assert isotherm.convert(arrays, mapping(column="t")).tobytes() == right.tobytes()

    since = isotherm.convert(readings(t=ns - ns[0] + 10_000_000), mapping(column="t", unit="ns"))
    durations = pd.to_timedelta(ns - ns[0] + 10_000_000, unit="ns")
    for times in (durations, pd.Series(list(durations), dtype=object), pd.Series([step.to_pytimedelta() for step in durations], dtype=object)):
        assert isotherm.convert(readings(t=times), mapping(column="t")).tobytes() == since.tobytes()

    part = isotherm.convert(readings(t=stamps), mapping(column="t"), start=stamps[10].to_pydatetime(), end=stamps[19])
    assert (part["timestamp_ns"] == ns[10:20]).all()
    last = isotherm.convert(readings(t=stamps), mapping(column="t"), start=pd.Timedelta("400ms"), interval=timedelta(milliseconds=10))
    assert (last["timestamp_ns"] == ns[40:]).all()


def test_convert_refuses_times_that_are_none_and_units_that_are_not_theirs() -> None:
    stamps = pd.date_range("2026-05-01", periods=50, freq="10ms", tz="UTC")
    with pytest.raises(ValueError, match="time.unit is 's', but t has times"):
        isotherm.convert(readings(t=stamps), mapping(column="t", unit="s"))
    missing = stamps.to_series(index=range(50))
    missing[7] = pd.NaT
    for times in (missing, missing.astype(object), missing.to_numpy(dtype="datetime64[ns]")):
        with pytest.raises(ValueError, match="t: row 7 is (NaT|None), give a time"):
            isotherm.convert(readings(t=times), mapping(column="t"))
    early = pd.Series([datetime(1, 1, 1), *stamps[1:].tz_localize(None).to_pydatetime()], dtype=object)
    with pytest.raises(ValueError, match="t: row 0 is .*64 bits"):
        isotherm.convert(readings(t=early), mapping(column="t"))
    with pytest.raises(ValueError, match="t has the shape \\(50, 2\\)"):
        isotherm.convert({"t": np.zeros((50, 2)), "ax": np.zeros(50)}, mapping(column="t"))


def test_convert_counts_rows_from_0() -> None:
    good = readings(t=0.01 * np.arange(1, 301))
    seconds = mapping(column="t", unit="s")
    wrong = good.assign(ax=good["ax"].astype(object))
    wrong.loc[5:20, "ax"] = "bad"
    with pytest.raises(isotherm.RecordingFault, match="^array: row 5: ") as fault:
        isotherm.convert(wrong, seconds)
    assert fault.value.line == 5
    few = good.assign(ax=good["ax"].astype(object))
    few.loc[100, "ax"] = "bad"
    with pytest.warns(UserWarning, match="the first is row 100: "):
        isotherm.convert(few, seconds)
    still = good.copy()
    still.loc[200, "t"] = 900.0
    with pytest.warns(UserWarning, match="the first is row 200, "):
        isotherm.convert(still, seconds)
    with pytest.raises(isotherm.RecordingFault, match="^array: missing columns: ax"):
        isotherm.convert(good.rename(columns={"ax": "other"}), seconds)
    plain = good.to_numpy()[:, [0, 1, 2, 3]].copy()
    plain[3:30, 1] = np.nan
    numbered = mapping(column=1, unit="s") | {"accelerometer": mapping()["accelerometer"] | {"columns": [2, 3, 4]}}
    with pytest.raises(isotherm.RecordingFault, match="^array: row 3: "):
        isotherm.convert(plain, numbered)


def test_rates_in_two_dimensions_are_of_several_axes() -> None:
    generator = np.random.default_rng(3)
    frame = pd.DataFrame(generator.normal(size=(5000, 3)), columns=["ax", "ay", "az"])
    heads = np.linspace(20.0, 30.0, 5000)
    found = isotherm.noise(frame, interval=0.01, temperature=heads)
    assert [sensor["sensor"] for sensor in found["sensors"]] == ["ax", "ay", "az"]
    for name, sensor in zip(frame, found["sensors"], strict=True):
        alone = isotherm.noise(frame[name], interval=0.01, temperature=heads)
        assert {key: value for key, value in sensor.items() if key != "sensor"} == {key: value for key, value in alone.items() if key != "sensor"}
    by_number = isotherm.noise(frame.to_numpy(), interval=0.01)
    assert [sensor["sensor"] for sensor in by_number["sensors"]] == ["0", "1", "2"]
    assert isotherm.noise(pl.from_pandas(frame), interval=0.01) == isotherm.noise(frame, interval=0.01)
    with pytest.raises(ValueError, match="rates has the shape \\(3, 5000\\), give a column for each axis"):
        isotherm.noise(frame.to_numpy().T, interval=0.01)
    with pytest.raises(ValueError, match="rates has the shape \\(10, 10, 50\\)"):
        isotherm.noise(frame.to_numpy()[:, 0].reshape(10, 10, 50), interval=0.01)
    with pytest.raises(ValueError, match="temperature has 2 columns and rates have 3"):
        isotherm.noise(frame, interval=0.01, temperature=np.zeros((5000, 2)))
    with pytest.raises(isotherm.NoiseError, match="^ay: "):
        isotherm.noise(frame.assign(ay=np.nan), interval=0.01)
    with pytest.raises(ValueError, match="missing columns"):
        isotherm.noise(frame)


def test_nothing_is_flattened_in_silence() -> None:
    samples, table = isotherm.read_recording(RUN), isotherm.Table.load(TABLE)
    square = samples[:4].reshape(2, 2)
    assert isotherm.replay(table, square).shape == (2, 2)
    for call in (
        lambda: isotherm.verify(table, square),
        lambda: isotherm.noise(square),
        lambda: isotherm.lengths(table, square),
        lambda: isotherm.write_recording("never.csv", square),
        lambda: isotherm.write_increments("never.csv", isotherm.replay(table, square)),
        lambda: isotherm.calibrate_warm_up(square, "imu-a"),
    ):
        with pytest.raises(ValueError, match="has the shape \\(2, 2\\), give one of one dimension"):
            call()
    for name in ("x", "y", "weights"):
        given: dict[str, Any] = {"x": [1.0, 2.0, 3.0, 4.0], "y": [1.0, 2.0, 3.5, 4.0]} | {name: np.ones((2, 2))}
        with pytest.raises(ValueError, match=f"{name} has the shape \\(2, 2\\)"):
            isotherm.regress(**given)
    assert not Path("never.csv").exists()


def test_rows_out_of_order_are_found_as_by_the_command(tmp_path: Path) -> None:
    samples, table = isotherm.read_recording(RUN), isotherm.Table.load(TABLE)
    back = samples.copy()
    back["sequence"][5] = back["sequence"][3]
    isotherm.write_recording(tmp_path / "back.csv", back)
    command = subprocess.run([BINARY, "verify", "--table", TABLE, tmp_path / "back.csv"], capture_output=True, text=True)
    message = command.stderr.partition("back.csv:7: ")[2].partition("\n")[0]
    assert message.startswith("sequence "), command
    for call in (
        lambda: isotherm.verify(table, back),
        lambda: isotherm.noise(back),
        lambda: isotherm.noise(back, table=table),
        lambda: isotherm.lengths(table, back),
        lambda: isotherm.noise(isotherm.to_frame(back)),
        lambda: isotherm.calibrate_warm_up(back, "imu-a"),
    ):
        with pytest.raises(isotherm.RecordingFault) as fault:
            call()
        assert fault.value.line == 5 and f"row 5: {message}" in str(fault.value)
    with pytest.raises(isotherm.RecordingFault, match="array: row 1: sequence .* must rise"):
        isotherm.verify(table, samples[::-1])
    with pytest.raises(isotherm.RecordingFault, match="row 5: sequence .* of session 1, whose rows"):
        again = samples.copy()
        again["session"], again["session"][4] = 1, 2
        again["sequence"][5] = again["sequence"][0]
        isotherm.verify(table, again)
    with pytest.warns(UserWarning, match="row 5: sequence"):
        assert len(isotherm.replay(table, back)) == len(back)
    with pytest.raises(isotherm.RecordingFault, match="back.csv:7: sequence") as fault:
        isotherm.read_recording(tmp_path / "back.csv")
    assert fault.value.line == 7


def test_a_recording_is_written_in_the_format_of_its_name(tmp_path: Path) -> None:
    samples = isotherm.read_recording(RUN)
    samples["session"], samples["telemetry_ns"], samples["device"], samples["sent_ns"] = 7, samples["timestamp_ns"], 0xABC, 5
    begins = {".csv": b"session,sequence,", ".mcap": b"\x89MCAP", ".MCAP": b"\x89MCAP"}
    for suffix, begin in begins.items():
        path = tmp_path / f"run{suffix}"
        isotherm.write_recording(path, samples, imu="imu-a")
        assert path.read_bytes().startswith(begin), suffix
        read = isotherm.read_recording(path)
        read["sent_ns"] = 5
        assert read.tobytes() == samples.tobytes(), suffix
        isotherm.write_recording(path, samples[:3], imu="imu-a")
        assert len(isotherm.read_recording(path)) == 3, "replaced"
        replayed = subprocess.run([BINARY, "replay", "--table", TABLE, path], capture_output=True, text=True, check=True)
        assert len(replayed.stdout.splitlines()) == 4
    with pytest.raises(isotherm.RecordingFault, match="imu-b"):
        isotherm.read_recording(tmp_path / "run.mcap", imu="imu-b")
    increments = isotherm.replay(isotherm.Table.load(TABLE), samples)
    for name in ("run.txt", "run", "run.csv.gz", "-"):
        for write in (lambda path: isotherm.write_recording(path, samples), lambda path: isotherm.write_increments(path, increments)):
            with pytest.raises(ValueError, match=r"name the recording \.csv or \.mcap"):
                write(tmp_path / name)
    with pytest.raises(ValueError, match="not a valid name"):
        isotherm.write_recording(tmp_path / "x.mcap", samples, imu="no name")
    assert not list(tmp_path.glob("*.txt")) and not (tmp_path / "x.mcap").exists()
    with pytest.raises(ValueError, match=r"isotherm\.to_arrow"):
        isotherm.write_recording(tmp_path / "x.parquet", samples)


def test_a_recording_is_read_in_pieces_by_names_and_patterns(tmp_path: Path) -> None:
    samples = isotherm.read_recording(RUN)
    third = len(samples) // 3
    isotherm.write_recording(tmp_path / "flight-2.mcap", samples[third : 2 * third])
    isotherm.write_recording(tmp_path / "flight-1.mcap", samples[:third])
    isotherm.write_recording(tmp_path / "flight-3.csv", samples[2 * third :])
    pattern = tmp_path / "flight*"
    for named in (pattern, str(pattern), [tmp_path / "flight*.csv", tmp_path / "flight*.mcap"], sorted(tmp_path.iterdir(), reverse=True)):
        assert isotherm.read_recording(named).tobytes() == samples.tobytes()
    assert isotherm.read_recording(tmp_path / "flight*.mcap").tobytes() == samples[: 2 * third].tobytes()
    begin_s = (samples["timestamp_ns"][0] - samples["interval_ns"][0]) / 1e9
    part = isotherm.read_recording(pattern, start=f"{samples['timestamp_ns'][5]}ns", end=pd.Timedelta(int(samples["timestamp_ns"][19]) / 1e9 - begin_s, "s"))
    assert part.tobytes() == samples[5:20].tobytes()
    (tmp_path / "odd[1].csv").write_bytes(RUN.read_bytes())
    assert isotherm.read_recording(tmp_path / "odd[1].csv").tobytes() == samples.tobytes()
    with pytest.raises(FileNotFoundError, match="no file has a name like this"):
        isotherm.read_recording(tmp_path / "none*.csv")
    with pytest.raises(FileNotFoundError):
        isotherm.read_recording(tmp_path / "none.csv")
    with pytest.raises(ValueError, match="named twice"):
        isotherm.read_recording([RUN, RUN])
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((tmp_path / "flight-1.mcap").read_bytes()[:-200])
    with pytest.warns(UserWarning, match="truncated"):
        assert isotherm.read_recording(cut).tobytes() == samples[:third].tobytes()[: len(isotherm.read_recording(cut)) * 256]


def test_increments_are_written_in_the_format_of_the_name(tmp_path: Path) -> None:
    increments = isotherm.replay(isotherm.Table.load(TABLE), isotherm.read_recording(RUN))
    increments["session"], increments["latency_ns"] = 9, 7
    for suffix, begin in {".csv": b"sequence,", ".mcap": b"\x89MCAP"}.items():
        path = tmp_path / f"increments{suffix}"
        isotherm.write_increments(path, increments, imu="imu-a")
        assert path.read_bytes().startswith(begin)
        read = isotherm.read_increments(path)
        if suffix == ".csv":
            read["session"], read["latency_ns"] = 9, 7
        assert read.tobytes() == increments.tobytes(), suffix


def test_rows_of_a_campaign_are_counted_from_0() -> None:
    rows = np.zeros(3, isotherm.CAMPAIGN)
    rows["position"] = 1
    rows["sequence"], rows["timestamp_ns"], rows["interval_ns"] = [0, 1, 1], [1, 2, 3], 1
    campaign = REPOSITORY / "examples/campaign/campaign.toml"
    with pytest.raises(isotherm.RecordingFault, match="^samples: row 2: sequence 1 after 1") as fault:
        isotherm.calibrate_turntable(campaign, rows)
    assert fault.value.line == 2
    frame = isotherm.to_frame(np.zeros(3, isotherm.CAMPAIGN))
    frame["position"] = [0.0, 0.5, np.nan]
    with pytest.raises(ValueError, match="position: row 1 is 0.5"):
        isotherm.calibrate_turntable(campaign, frame)
