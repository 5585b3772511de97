"""Parameters of PX4 and ArduPilot: what ground stations read of them."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import isotherm
import pytest
from conftest import BINARY, REPOSITORY
from pymavlink import mavparm

DATA = REPOSITORY / "recording/autopilot/tests/data"
MEMS: dict[str, Any] = {"imu": "imu-a", "interval": 0.0025}


def loaded(path: Path) -> dict[str, float]:
    """The parameters of a file, as MAVProxy and others read it."""
    parameters = mavparm.MAVParmDict()
    assert parameters.load(str(path))
    return {name: float(parameters[name]) for name in parameters}


def test_pymavlink_reads_a_parm_as_it_was_written(tmp_path: Path) -> None:
    table = isotherm.import_parameters((DATA / "full.params").read_text(), "px4", **MEMS)
    exported = isotherm.export_parameters(table, to="ardupilot", instance=2, at=25.0)
    path = tmp_path / "imu-a.parm"
    path.write_text(exported.text)
    found = loaded(path)
    assert found == {name: float(value) for name, value in (line.split() for line in str(exported).splitlines())}
    assert len(found) == 29 and found["INS_TCAL2_ENABLE"] == 1.0 and found["INS_GYR2_CALTEMP"] == 25.0
    # What it has read, written by pymavlink, is the same table.
    again = mavparm.MAVParmDict()
    again.update(found)
    again.save(str(tmp_path / "again.parm"))
    back = isotherm.import_parameters((tmp_path / "again.parm").read_text(), "ardupilot", instance=2, **MEMS)
    for axis, other in zip(table.axes, back.axes, strict=True):
        for celsius in (-17.0, 25.0, 70.0):
            # 1 ug0 is 9.8e-6 m/s2; pymavlink writes six decimals.
            assert axis.bias(celsius) == pytest.approx(other.bias(celsius), abs=0.1)


def test_pymavlink_reads_the_files_of_ardupilot_as_isotherm_does() -> None:
    found = loaded(DATA / "full.parm")
    table = isotherm.import_parameters((DATA / "full.parm").read_text(), "ardupilot", gravity=9.81, **MEMS)
    slopes = [found[f"INS_TCAL1_ACC1_{axis}"] for axis in "XYZ"]
    for axis, slope in zip(table.axes, slopes, strict=True):
        assert (axis.bias.center, axis.bias.unit) == (35.0, "ug0")
        assert axis.bias.coefficients[1] == pytest.approx(slope / 9.81, rel=1e-7)


def test_the_command_writes_the_same(tmp_path: Path) -> None:
    text = (DATA / "full.params").read_text()
    table = isotherm.import_parameters(text, "px4", **MEMS)
    arguments = ["import", str(DATA / "full.params"), "--from", "px4", "--imu", "imu-a", "--interval", "0.0025", "-o", "imu-a.toml"]
    subprocess.run([BINARY, *arguments], check=True, cwd=tmp_path, capture_output=True)
    assert isotherm.Table.load(tmp_path / "imu-a.toml") == table
    arguments = ["export", "imu-a.toml", "--to", "px4", "--device-id", "3014666,3080202", "-o", "-"]
    written = subprocess.run([BINARY, *arguments], check=True, cwd=tmp_path, capture_output=True, text=True).stdout
    exported = isotherm.export_parameters(table, to="px4", device_id=(3014666, 3080202))
    assert exported.text == written and exported.lost == [] and exported.notes == []
    accelerometers, gyroscopes = exported.difference
    assert 0.0 < accelerometers < 2e-6 and gyroscopes is not None and 0.0 < gyroscopes < 2e-7


def test_what_cannot_be_is_refused() -> None:
    text = (DATA / "full.parm").read_text()
    with pytest.raises(isotherm.TableError, match="parameters:2: INS_TCAL1_TMIN: is \"nan\"") as refused:
        isotherm.import_parameters(text.replace("TMIN -17.6", "TMIN nan"), "ardupilot", **MEMS)
    assert [fault[:2] for fault in refused.value.faults] == [(2, "INS_TCAL1_TMIN")]
    for wrong in ({"imu": "no id"}, {"interval": 0.0}, {"interval": float("nan")}, {"gravity": 1.0}, {"instance": 6}):
        with pytest.raises(ValueError):
            isotherm.import_parameters(text, "ardupilot", **{**MEMS, **wrong})
    with pytest.raises(ValueError, match="autopilot: is \"px5\""):
        isotherm.import_parameters(text, "px5", **MEMS)
    table = isotherm.Table.load(REPOSITORY / "examples/tables/imu-b.toml")
    effects = ["scale-temperature", "negative-scale", "alignment"]
    with pytest.raises(isotherm.TableError, match=r'drop=\["alignment"\] leaves it out'):
        isotherm.export_parameters(table, to="px4", device_id=7, drop=effects[:2])
    exported = isotherm.export_parameters(table, to="px4", device_id=7, drop=effects)
    assert [lost[0] for lost in exported.lost] == effects
    assert exported.lost[2][1] == ["A1", "A2", "A3"] and exported.lost[2][3] is None
    with pytest.raises(ValueError, match="drop: is \"scale\""):
        isotherm.export_parameters(table, to="px4", device_id=7, drop=["scale"])
    with pytest.raises(ValueError, match="device number"):
        isotherm.export_parameters(table, to="px4")
