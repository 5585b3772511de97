"""Runs the examples, and the code of docs/python.md and of the README."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import isotherm
import numpy as np
import pandas as pd
import pytest
from conftest import BINARY, CAMPAIGN, EXAMPLES, MEMS_TABLE, REPOSITORY, RUN, TABLE, TIMEOUT, DomainUnderTest

DOCUMENT = REPOSITORY / "docs/python.md"


def blocks(path: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```$", path.read_text(), re.MULTILINE | re.DOTALL)


def example(name: str, *arguments: str | Path) -> str:
    done = subprocess.run([sys.executable, EXAMPLES / name, *arguments], capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_acquisition_and_reader(domain: DomainUnderTest) -> None:
    domain.serve()
    reader = domain.start(sys.executable, EXAMPLES / "reader.py", "--count", "60")
    assert reader.stdout is not None and reader.stdout.readline() == "connected\n"
    assert "60 samples, velocity [" in example("acquisition.py", "--count", "60")
    assert reader.communicate(timeout=TIMEOUT)[0].endswith("60 increments\n")
    assert reader.returncode == 0


def test_an_acquisition_that_is_started_again_goes_on_with_its_lag(domain: DomainUnderTest, tmp_path: Path) -> None:
    domain.serve()
    state = tmp_path / "lag.json"
    for _ in range(2):
        example("acquisition.py", "--count", "60", "--serial", "SN 42", "--state", state)
        # The share of an unknown start is 0: the clock goes on.
        # The last number is the machine's start.
        assert [kept and kept[1:4] for kept in json.loads(state.read_text())] == [[2.5, 2.5, 0.0]] * 3 + [None] * 3


def status(domain: DomainUnderTest) -> dict[str, int]:
    imu: dict[str, int] = json.loads(domain.isotherm("status", "--json"))["imus"][0]
    return imu


def generated(table: Path, periods: int) -> np.ndarray:
    """Velocity and angle of what paced.py reads, as the kernel computes them."""
    number = np.arange(periods)
    turn = number % 100
    slow = np.round(729.2 * (number + 1)) - np.round(729.2 * number)  # what rounding leaves is carried
    samples = np.zeros(periods, isotherm.RAW_SAMPLE)
    samples["sequence"], samples["interval_ns"] = number, 2_500_000
    samples["timestamp_ns"] = (number + 1) * 2_500_000
    accelerometers, gyroscopes = samples["accelerometers"], samples["gyroscopes"]
    accelerometers["positive_pulses"] = np.stack([100_000 + 100 * turn, 0 * turn, 0 * turn + 9_806_650], axis=1)
    accelerometers["negative_pulses"] = (0, 300_000, 0)
    gyroscopes["positive_pulses"] = np.stack([0 * turn + 100_000, 0 * turn, slow], axis=1)
    gyroscopes["negative_pulses"] = np.stack([0 * turn, 200_000 - 100 * turn, 0 * turn], axis=1)
    for triad in (accelerometers, gyroscopes):
        triad["head_temperature"] = triad["board_temperature"] = (31.25 + 1e-6 * (number // 40 * 40))[:, None]
    return sums(isotherm.replay(isotherm.Table.load(table), samples))


def sums(increments: np.ndarray) -> np.ndarray:
    return np.concatenate([increments["velocity_increment"].sum(axis=0), increments["angle_increment"].sum(axis=0)])


@pytest.mark.parametrize("stands_still_s, away_s, periods", [(0.4, 0.0, 800), (0.0, 10.0, 5000)])
def test_paced_loses_nothing_without_the_service(
    domain: DomainUnderTest, stands_still_s: float, away_s: float, periods: int
) -> None:
    table = domain.folder / MEMS_TABLE.name
    shutil.copy(MEMS_TABLE, table)
    service = domain.spawn("--imu", f"imu-mems={table}").wait_until_ready()
    read: list[isotherm.Records] = []
    is_reading, has_ended = threading.Event(), threading.Event()

    def read_on() -> None:
        """All the time, as navigation does: after the outage increments come faster than a queue lasts."""
        with isotherm.IncrementReader("imu-mems", timeout=TIMEOUT) as reader:
            is_reading.set()
            while not has_ended.is_set():
                read.append(reader.read_available())
                time.sleep(0.005)
            read.append(reader.read_available())

    reading = threading.Thread(target=read_on)
    reading.start()
    try:
        assert is_reading.wait(TIMEOUT)
        paced = domain.start(sys.executable, EXAMPLES / "paced.py", "--periods", str(periods))
        deadline = time.monotonic() + TIMEOUT
        while status(domain)["received"] < 20:
            assert time.monotonic() < deadline
        if stands_still_s:
            service.pause()
            time.sleep(stands_still_s)  # longer than 64 periods
        service.kill()
        time.sleep(away_s)
        domain.spawn("--imu", f"imu-mems={table}").wait_until_ready()
        out = paced.communicate(timeout=TIMEOUT)[0]
    finally:
        has_ended.set()
        reading.join()
    assert paced.returncode == 0 and f"{periods} periods: {periods} increments, 0 lost" in out, out
    increments, exact = np.concatenate(read), generated(table, periods)
    assert not np.any(increments["flags"] & ~np.uint64(isotherm.Flags.LATE)), "no gap, no time step, no interval-not-nominal"
    assert increments["sequence"].tolist() == list(range(periods)) and np.all(increments["interval_ns"] == 2_500_000)
    np.testing.assert_allclose(sums(increments), exact, rtol=1e-9, atol=1e-8)
    printed = [float(value) for line in out.splitlines()[-2:] for value in line.split()[1:-1]]
    np.testing.assert_allclose(printed, exact, rtol=1e-9, atol=1e-8)
    assert status(domain)["missing"] == 0


def test_round_trip(domain: DomainUnderTest) -> None:
    domain.serve()
    assert len(example("round_trip.py", "--blocks", "1").splitlines()) == 7


def test_calibrate(tmp_path: Path) -> None:
    out = example("calibrate.py", CAMPAIGN, tmp_path)
    assert "chosen: 3" in out
    assert isotherm.Table.load(tmp_path / "table.toml").imu
    assert (tmp_path / "calibration.html").stat().st_size > 10_000


def test_the_plain_way(domain: DomainUnderTest, table: isotherm.Table) -> None:
    """The example with only iceoryx2's wheel and ctypes: an `IncrementReader` reads the same increments at the same time."""
    domain.serve()
    with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader:
        out = example("plain_iceoryx2.py", "--isotherm", BINARY, "--count", "20", "--serial", "SN 42")
        read = reader.read_available()
    rows = [line.split() for line in out.splitlines()]
    assert [int(row[0]) for row in rows] == list(range(20))
    assert [[float(value) for value in row[1:4]] for row in rows] == read["velocity_increment"].tolist()
    # The table has no gyroscopes.
    assert {value for row in rows for value in row[4:7]} == {"nan"} and np.isnan(read["angle_increment"]).all()
    assert {row[7] for row in rows} == {f"{table.id:016x}"}
    assert read["session"][0] > 0 and read["sequence"].tolist() == list(range(20))


def test_the_plain_peers_structures_are_the_wire() -> None:
    spec = importlib.util.spec_from_file_location("plain", EXAMPLES / "plain_iceoryx2.py")
    assert spec is not None and spec.loader is not None
    plain = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plain)
    for structure, dtype in (
        (plain.Triad, isotherm.TRIAD),
        (plain.RawSample, isotherm.RAW_SAMPLE),
        (plain.CompensatedIncrement, isotherm.INCREMENT),
    ):
        offsets = {name: getattr(structure, name).offset for name, _ in structure._fields_}
        assert offsets == {name: field[1] for name, field in (dtype.fields or {}).items()}
        assert ctypes.sizeof(structure) == dtype.itemsize
    assert plain.device(" SN 42 ") == isotherm.device("SN 42") and plain.device(" ") == 0


@pytest.mark.parametrize("document", [DOCUMENT, REPOSITORY / "python/README.md"], ids=["docs", "readme"])
def test_what_the_documents_show(domain: DomainUnderTest, document: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs all blocks of a document, one after the other, as one program with a service."""
    domain.serve()
    for file in (TABLE, RUN, CAMPAIGN, CAMPAIGN.with_name("samples.csv")):
        shutil.copy(file, domain.folder)
    shutil.copy(REPOSITORY / "calibration/fit/tests/data/any_lab/tumble3/recording.csv", domain.folder / "tumble.csv")
    shutil.copy(REPOSITORY / "recording/formats/tests/data/autopilots/heating.BIN", domain.folder / "warm-up.BIN")
    domain.isotherm("simulate", "run", "-o", domain.folder / "still", "--interval", "1")
    monkeypatch.chdir(domain.folder)
    program = "\n".join(blocks(document))
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr


def test_what_the_page_on_comparisons_shows(tmp_path: Path) -> None:
    """Runs its code on the tables of four years, and on those of five IMUs."""
    tables = REPOSITORY / "calibration/fit/tests/data/any_lab/compare"
    for year in ("2023", "2024", "2025", "2026"):
        shutil.copy(tables / f"{year}.toml", tmp_path)
    for index, name in enumerate(("imu-a", "imu-b", "imu-c", "imu-d", "imu-e")):
        text = (tables / f"{2023 + index % 4}.toml").read_text()
        (tmp_path / f"{name}.toml").write_text(text.replace('"imu-a"', f'"{name}"').replace("c0 = 7", f"c0 = 7{index}"))
    program = "\n".join(blocks(REPOSITORY / "docs/compare.md"))
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    assert "'A1 bias'" in done.stdout and "No device stands out" in done.stdout


def test_what_the_page_on_calibration_shows(tmp_path: Path) -> None:
    """Runs its code on the log of a laboratory, with rows in which the turntable moves."""
    shutil.copy(CAMPAIGN, tmp_path)
    rows = pd.read_csv(CAMPAIGN.with_name("samples.csv"))
    log = pd.DataFrame({"time_s": rows["timestamp_ns"] / 1e9, "chamber_c": rows["set_point_c"], "pose": rows["position"]})
    for axis, name in (("a1", "x"), ("a2", "y"), ("a3", "z")):
        log[f"{name}+"], log[f"{name}-"] = rows[f"{axis}_positive"], rows[f"{axis}_negative"]
        log[f"T_{name}"] = rows[f"{axis}_head"]
    first = log["pose"].ne(log["pose"].shift()) & log["chamber_c"].eq(log["chamber_c"].shift())
    moving = log[first].assign(time_s=log["time_s"] - 20, pose=np.nan)
    log = pd.concat([log, moving]).sort_values("time_s", kind="stable")
    assert len(moving) == 165 and log["time_s"].diff().min() >= 10
    log.to_csv(tmp_path / "logger.csv", index=False)
    program = "\n".join(blocks(REPOSITORY / "docs/calibrate.md"))
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    assert re.match(r"bias \+- 0\.3\d ug0, scale factor \+- 0\.9\d ppm over ", done.stdout), done.stdout
    # The rows that it writes give the command the same table.
    made = isotherm.calibrate_turntable(tmp_path / "campaign.toml")
    assert made.table.id == isotherm.Table.load(tmp_path / "imu.toml").id


def of_another_device(samples: Path) -> None:
    """The samples of a campaign with one pulse more in each row of A2."""
    import pandas as pd

    frame = pd.read_csv(samples, dtype=str)
    frame["a2_positive"] = [str(int(count) + 1) for count in frame["a2_positive"]]
    frame.to_csv(samples, index=False)


def test_fleet(tmp_path: Path) -> None:
    """Campaigns on two workers: the tables are those of one by one, and one that fails does not stop the others."""
    names = ["imu-1", "imu-2", "imu-3"]
    for name in names:
        shutil.copytree(CAMPAIGN.parent, tmp_path / name)
        file = tmp_path / name / "campaign.toml"
        file.write_text(file.read_text().replace('"imu-paper"', f'"{name}"'))
    # The second one has lost its samples.
    (tmp_path / "imu-2" / "samples.csv").unlink()
    of_another_device(tmp_path / "imu-3" / "samples.csv")
    # The third one has a second campaign.
    shutil.copytree(tmp_path / "imu-3", tmp_path / "again")
    campaigns = [tmp_path / name / "campaign.toml" for name in [*names, "again"]]
    arguments = [sys.executable, EXAMPLES / "fleet.py", *campaigns, "-o", tmp_path / "tables", "--workers", "2"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=150)
    assert done.returncode == 1, done.stderr
    assert "2 tables, 2 campaigns failed\nbatch of 2 devices\n" in done.stdout, done.stdout
    assert f"{campaigns[1]}: failed: [Errno 2] No such file or directory" in done.stderr
    assert f"{campaigns[3]}: failed: {campaigns[2]} is a campaign of imu-3 too; give one" in done.stderr
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == ["fleet.csv", "imu-1.html", "imu-1.toml", "imu-3.html", "imu-3.toml"]

    fleet = pd.read_csv(tmp_path / "tables/fleet.csv", index_col="campaign")
    assert list(fleet.index) == [str(campaign) for campaign in campaigns]
    assert fleet["error"].notna().tolist() == [False, True, False, True]
    assert fleet["imu"].dropna().tolist() == ["imu-1", "imu-3"] and (fleet["a1_bias_band_g0"].dropna() > 0.0).all()

    def without_time(text: str) -> str:
        return re.sub(r"^time = .*\n", "", text, flags=re.MULTILINE)

    for name in ("imu-1", "imu-3"):
        alone = isotherm.calibrate_turntable(tmp_path / name / "campaign.toml").text
        assert without_time((tmp_path / "tables" / f"{name}.toml").read_text()) == without_time(alone)


def test_fleet_without_statistics(tmp_path: Path) -> None:
    """Tables that are no batch are kept, and the reason is reported."""
    for name, unit in (("imu-1", "V"), ("imu-2", "other")):
        shutil.copytree(CAMPAIGN.parent, tmp_path / name)
        file = tmp_path / name / "campaign.toml"
        text = file.read_text().replace('"imu-paper"', f'"{name}"')
        file.write_text(re.sub(r'temperature_unit = ".*"', f'temperature_unit = "{unit}"', text))
    of_another_device(tmp_path / "imu-2" / "samples.csv")
    campaigns = [tmp_path / name / "campaign.toml" for name in ("imu-1", "imu-2")]
    arguments = [sys.executable, EXAMPLES / "fleet.py", *campaigns, "-o", tmp_path / "tables", "--workers", "1"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=150)
    assert done.returncode == 1, done.stderr
    assert "2 tables, 0 campaigns failed\n" in done.stdout, done.stdout
    assert "failed: statistics of the batch: temperature in V and other" in done.stderr


def test_a_fleet_is_judged(tmp_path: Path) -> None:
    """With --verify each row has a verdict; a campaign without the recording has the reason."""
    for name in ("imu-1", "imu-2"):
        shutil.copytree(CAMPAIGN.parent, tmp_path / name)
        file = tmp_path / name / "campaign.toml"
        file.write_text(file.read_text().replace('"imu-paper"', f'"{name}"'))
    of_another_device(tmp_path / "imu-2" / "samples.csv")
    subprocess.run([BINARY, "simulate", "run", "-o", tmp_path / "imu-1", "--interval", "1"], check=True, capture_output=True, timeout=TIMEOUT)
    campaigns = [tmp_path / name / "campaign.toml" for name in ("imu-1", "imu-2")]
    arguments = [sys.executable, EXAMPLES / "fleet.py", *campaigns, "-o", tmp_path / "tables", "--workers", "1", "--verify", "run.csv"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=150)
    assert done.returncode == 1, done.stderr
    fleet = pd.read_csv(tmp_path / "tables/fleet.csv")
    assert str(fleet["met"][0]) == "True" and "factor" in fleet["verdict"][0]
    assert "run.csv" in fleet["error"][1] and (tmp_path / "tables/imu-2.toml").exists()


def test_the_pool_of_the_fleet_page(tmp_path: Path) -> None:
    """One bad campaign has a reason, and the other its accuracy."""
    (tmp_path / "pool.py").write_text(blocks(REPOSITORY / "docs/fleet.md")[1])
    shutil.copytree(CAMPAIGN.parent, tmp_path, dirs_exist_ok=True)
    done = subprocess.run([sys.executable, "pool.py"], capture_output=True, text=True, timeout=150, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    good, bad = done.stdout.splitlines()
    assert good.startswith("campaign.toml bias +- ") and bad.startswith("missing.toml [Errno 2] No such file")
