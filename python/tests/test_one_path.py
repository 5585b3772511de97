"""One path for one job: the command and the package give the same table, findings and class of exit."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import isotherm
from conftest import BINARY, CAMPAIGN, REPOSITORY, WHOLE_CAMPAIGN, WHOLE_TABLE
from isotherm._errors import in_python

DATA = REPOSITORY / "calibration/fit/tests/data"
GRAVITY_ONLY = """format = 1
imu = "imu-t"
method = "gravity-only"
samples = "recording.csv"
gravity_local = 9.81
gravity_reference = 9.81
temperature_unit = "degC"
"""


def command(*arguments: str | Path) -> tuple[int, list[str]]:
    """The exit code, and the findings that are printed."""
    done = subprocess.run([BINARY, *arguments], capture_output=True, text=True, timeout=200, check=False)
    lines = [line.removeprefix("isotherm: ") for line in done.stderr.splitlines()]
    return done.returncode, [line for line in lines if re.match(r"(fault|warning) \[", line)]


def package(campaign: Path, by_hand: bool, **options: Any) -> tuple[int, list[str], str]:
    """What the command would end with, the findings, and the text of the table."""
    calibrate: Any = isotherm.calibrate_tumble if by_hand else isotherm.calibrate_turntable
    try:
        found = calibrate(campaign, **options)
    except isotherm.CalibrationError as error:
        return 65, str(error).splitlines(), ""
    return 0, [f"{severity} {message}" for severity, _, message in found.findings], found.text


def cases(folder: Path) -> list[tuple[str, Path, bool, list[str], dict[str, Any]]]:
    """Campaigns with their options for the command and for the package."""
    tumble = folder / "tumble.toml"
    tumble.write_text(GRAVITY_ONLY)
    shutil.copy(DATA / "any_lab/tumble3/recording.csv", folder / "recording.csv")
    late = folder / "late.toml"
    late.write_text(GRAVITY_ONLY.replace("recording.csv", "late.csv"))
    text = (folder / "recording.csv").read_text()
    (folder / "late.csv").write_text(re.sub(r"^(\d+,\d+),(\d+)", lambda row: f"{row[1]},{int(row[2]) * 97 // 100}", text, flags=re.MULTILINE))
    short = folder / "short"
    short.mkdir()
    shutil.copy(CAMPAIGN, short / "campaign.toml")
    rows = CAMPAIGN.with_name("samples.csv").read_text().splitlines(keepends=True)
    (short / "samples.csv").write_text("".join(rows[: len(rows) // 2]))
    return [
        ("campaign", CAMPAIGN, False, [], {}),
        ("whole", WHOLE_CAMPAIGN, False, [], {}),
        ("turns", DATA / "gyro/campaign.toml", False, [], {}),
        ("ramps", DATA / "ramp/campaign.toml", False, [], {}),
        ("two-stage", CAMPAIGN, False, ["--method", "two-stage", "--order", "2"], {"method": "two-stage", "order": 2}),
        ("tumble", tumble, True, [], {}),
        ("strict", tumble, True, ["--strict", "--order", "0"], {"strict": True, "order": 0}),
        ("late", late, True, [], {}),
        ("accepted", late, True, ["--accept", "interval"], {"accept": ["interval"]}),
        ("short", short / "campaign.toml", False, [], {}),
    ]


def test_the_command_and_the_package_are_one_path(tmp_path: Path) -> None:
    for name, campaign, by_hand, arguments, options in cases(tmp_path):
        output = tmp_path / f"table-{name}.toml"
        code, findings = command("calibrate", "tumble" if by_hand else "turntable", campaign, "-o", output, *arguments)
        same, told, text = package(campaign, by_hand, **options)
        assert code == same, (name, code, findings, told)
        # The package says arguments where the command says options.
        findings = [in_python(finding) for finding in findings]
        if code == 0:
            # Lines of the samples have their file in front; the package gives them apart.
            bare = [re.sub(r"\]: \S+?:\d+: ", "]: ", finding) for finding in findings]
            assert [re.sub(r"\]: \S+?:\d+: ", "]: ", finding) for finding in told] == bare, name
            without_time = re.compile(r"^time = .*\n", re.MULTILINE)
            assert without_time.sub("", text) == without_time.sub("", output.read_text()), name
        else:
            assert [line for line in told if re.match(r"(fault|warning) \[", line)] == findings, name
    assert {line.split("]")[0] for line in command("calibrate", "tumble", tmp_path / "late.toml", "-o", tmp_path / "x.toml")[1]} == {"fault [interval"}


def test_two_sessions_and_lag_in_some_rows_are_completed_alike(whole_table: isotherm.Table, whole: isotherm.Records, tmp_path: Path) -> None:
    """`replay` and the package complete the lag of two sessions; a recording with lag in some rows stays as it is."""
    some = whole.copy()
    some["lag_ns"][:500] = 240_000_000_000
    for triad in ("accelerometers", "gyroscopes"):
        some[triad]["head_lagged"][:500] = some[triad]["head_temperature"][:500] - 0.01
    results = []
    for samples in (whole, some):
        isotherm.write_recording(tmp_path / "plain.csv", samples)
        header, *rows = (tmp_path / "plain.csv").read_text().splitlines()
        first = [f"{1:016x},{row}" for row in rows[: len(rows) // 2]]
        second = [f"{2:016x},{row}" for row in rows[len(rows) // 2 :]]
        path = tmp_path / "sessions.csv"
        path.write_text("\n".join([f"session,{header}", *first, *second]) + "\n")
        read = isotherm.read_recording(path)
        assert sorted(set(read["session"].tolist())) == [1, 2]
        run = subprocess.run([BINARY, "replay", "--table", WHOLE_TABLE, path, "-o", tmp_path / "command.csv"], capture_output=True, text=True, timeout=100, check=False)
        assert run.returncode == 0, run.stderr
        isotherm.write_increments(tmp_path / "package.csv", isotherm.replay(whole_table, read))
        assert (tmp_path / "package.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()
        results.append((tmp_path / "package.csv").read_bytes())
    assert results[0] != results[1]



def test_verify_completes_the_lag_of_two_sessions_alike(whole_table: isotherm.Table, tmp_path: Path) -> None:
    """A run at rest in two sessions: `verify` and the package judge the same increments."""
    simulate = ["simulate", "run", "-o", tmp_path / "run", "--truth", WHOLE_TABLE, "--temperatures", "20,24", "--ramp", "60", "--hold", "120", "--interval", "1"]
    subprocess.run([BINARY, *simulate], check=True, capture_output=True, timeout=100)
    header, *rows = (tmp_path / "run/run.csv").read_text().splitlines()
    sessions = [f"{1 + (2 * number) // len(rows):016x},{row}" for number, row in enumerate(rows)]
    path = tmp_path / "sessions.csv"
    path.write_text("\n".join([f"session,{header}", *sessions]) + "\n")
    done = subprocess.run([BINARY, "verify", "--table", WHOLE_TABLE, path, "--json"], check=True, capture_output=True, timeout=100)
    found = isotherm.verify(whole_table, isotherm.read_recording(path))
    assert found.verdict == json.loads(done.stdout)
    once = subprocess.run([BINARY, "verify", "--table", WHOLE_TABLE, tmp_path / "run/run.csv", "--json"], check=True, capture_output=True, timeout=100)
    assert json.loads(once.stdout)["axes"] != json.loads(done.stdout)["axes"], "the second session begins soaked"
