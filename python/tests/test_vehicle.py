"""All IMUs of a log, and parts of recordings, as the commands have them."""

from __future__ import annotations

import random
import subprocess
from pathlib import Path

import pytest

import isotherm

from conftest import BINARY

DEVICES = [2753028, 3080202]


def log(path: Path, stuck: tuple[int, ...] = ()) -> Path:
    """A DataFlash log of two IMUs that warm up at rest for 600 s; the temperature of those of `stuck` stands."""
    draw = random.Random(3)
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 140, 35, PARM, QNff, TimeUS,Name,Value,Default",
        "FMT, 131, 54, IMU, QBffffffIIfBBHH, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        *(f"PARM, 7, INS_ACC{number}_ID, {device}, 0" for number, device in zip(("", "2"), DEVICES, strict=True)),
    ]
    for row in range(600):
        for imu in range(2):
            celsius = -10.0 + 0.09 * row + 3.0 * imu
            x, y, z = (size * celsius + draw.gauss(0.0, 0.003) for size in (1e-3, -2e-3, 3e-3))
            p, q, r = (size * celsius + draw.gauss(0.0, 1e-4) for size in (1e-5, 2e-5, -3e-5))
            shown = 25.0 if imu in stuck else celsius
            values = f"{p:.7f}, {q:.7f}, {r:.7f}, {x:.6f}, {y:.6f}, {z - 9.80665:.6f}"
            lines.append(f"IMU, {1000000 * row}, {imu}, {values}, 0, 0, {shown:.3f}, 1, 1, 1000, 1000")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_all_imus_of_a_log_get_the_tables_of_the_command(tmp_path: Path) -> None:
    path = log(tmp_path / "warm.log")
    vehicle = isotherm.calibrate_vehicle(path, "my-drone", order=1, lag="none")
    assert (sorted(vehicle), vehicle.refused) == ([0, 1], {})
    command = [BINARY, "calibrate", "warm-up", path, "--imu", "my-drone", "--order", "1", "--lag", "none"]
    outputs = ["-o", tmp_path / "{instance}.toml", "--export", f"px4={tmp_path / 'v.params'}"]
    subprocess.run([*command, *outputs], check=True, capture_output=True)
    for instance, made in vehicle.items():
        table = isotherm.Table.load(tmp_path / f"{instance}.toml")
        assert (table.digest, table.imu) == (made.table.digest, f"my-drone-{instance}")
        assert (made.provenance["instance"], made.provenance["device_id"]) == (instance, DEVICES[instance])
    assert vehicle.export("px4").text == (tmp_path / "v.params").read_text()
    assert "TC_A_ENABLE\t1\t6\n" in vehicle.export("px4").text
    # A table knows its place.
    assert isotherm.export_parameters(vehicle[1].table, to="ardupilot").text.startswith("INS_TCAL2_ENABLE 1\n")
    assert f"TC_A1_ID\t{DEVICES[1]}\t6" in isotherm.export_parameters(vehicle[1].table, to="px4").text
    # A single one is as before: a log with several needs its number.
    with pytest.raises(ValueError, match="several IMUs"):
        isotherm.calibrate_warm_up(path, "my-drone", order=1, lag="none")
    alone = isotherm.calibrate_warm_up(path, "my-drone-1", order=1, lag="none", instance=1)
    assert alone.table.digest == vehicle[1].table.digest


def test_an_imu_that_is_refused_has_its_exception_and_the_others_go_on(tmp_path: Path) -> None:
    vehicle = isotherm.calibrate_vehicle(log(tmp_path / "warm.log", stuck=(0,)), "my-drone", order=1, lag="none")
    assert (list(vehicle), list(vehicle.refused)) == ([1], [0])
    assert isinstance(vehicle.refused[0], isotherm.CalibrationError)
    exported = vehicle.export("px4")
    assert "ENABLE" not in exported.text
    assert "my-drone-0 has no parameters here" in exported.notes[0]
    with pytest.raises(ValueError, match="at is nan"):
        isotherm.calibrate_vehicle(tmp_path / "warm.log", "my-drone", at=float("nan"))
    with pytest.raises(FileNotFoundError):
        isotherm.calibrate_vehicle(tmp_path / "none.log", "my-drone")


def test_parts_are_those_of_the_command(tmp_path: Path) -> None:
    path = log(tmp_path / "warm.log")
    # The first row begins a second before its time stamp, 0: the rows of 100 s on have stamps from 100 s on.
    rows = isotherm.convert(path, instance=0)
    some = isotherm.convert(path, instance=0, start=100, end="450000000000ns")
    assert (rows["timestamp_ns"][99], len(rows)) == (99_000_000_000, 600)
    assert list(some["timestamp_ns"][[0, -1]]) == [100_000_000_000, 450_000_000_000]
    made = isotherm.calibrate_warm_up(path, "my-drone", order=1, lag="none", instance=0, start=100.0, end=450)
    assert made.provenance["part"] == "from 100 s to 450 s"
    again = isotherm.calibrate_warm_up(
        isotherm.convert(path, instance=0), "my-drone", nominal=made.table, order=1, lag="none", start=100.0, end=450
    )
    assert again.summary["order"]["order"] == 1
    for given, message in (
        ({"start": -1}, "start is -1.0: give seconds"),
        ({"end": "soon"}, "end is soon"),
        ({"start": 5, "end": 5.0}, "start is not before end: 5 s is not before 5 s"),
    ):
        with pytest.raises(ValueError, match=message):
            isotherm.convert(path, instance=0, **given)
    with pytest.raises(isotherm.RecordingFault, match="no row from 700 s on"):
        isotherm.convert(path, instance=0, start=700)
