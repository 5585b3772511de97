"""Calibrates hundreds of campaigns on all processors, or on the machines of a Dask cluster. docs/fleet.md shows it.

    python3 fleet.py lot-7/*/campaign.toml -o tables --workers 8
    python3 fleet.py lot-7/*/campaign.toml -o tables --scheduler tcp://10.0.0.1:8786

Needs `pip install pandas 'dask[distributed]'`. Each campaign gives TABLE.toml and TABLE.html, named after its IMU; `fleet.csv` in the same folder has a
row for each campaign: what was reached, the verdict of `--verify`, the findings, or the reason why it failed. A campaign that fails is reported with its
reason, and the others go on; then the exit code is 1. A second campaign of an IMU fails, because its table would replace the first one's. Workers on other
machines must see the same files.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

import isotherm
import pandas as pd
from dask.distributed import Client, LocalCluster, as_completed


def make_table(campaign: str, folder: str, run: str | None, require: str) -> dict[str, Any]:
    """Runs in a worker: a row of the data frame. What goes wrong with a campaign is in its row, so that no other one is stopped."""
    row: dict[str, Any] = {"campaign": campaign}
    try:
        calibration = isotherm.calibrate_turntable(campaign)
        table = Path(folder) / f"{calibration.table.imu}.toml"
        calibration.save(table, report=table.with_suffix(".html"))
        row |= {"imu": calibration.table.imu, "table": str(table), "accuracy": calibration.accuracy}
        for index, axis in enumerate(calibration.summary["axes"], 1):
            row[f"a{index}_bias_band_g0"] = axis["bias_band_g0"]
        row["findings"] = "; ".join(message for _, _, message in calibration.findings)
        if run is not None:
            samples = isotherm.read_recording(Path(campaign).with_name(run))
            judged = isotherm.verify(calibration.table, samples).judge(require)
            row["met"] = all(met for _, met, _ in judged)
            row["verdict"] = "; ".join(message for _, _, message in judged)
    except (isotherm.IsothermError, OSError, ValueError) as error:
        row["error"] = str(error)
    return row


def imus(campaign: str) -> list[str]:
    """The IMUs that a campaign file names. None if it cannot be read: the worker that tries says why."""
    try:
        content = tomllib.loads(Path(campaign).read_text(encoding="utf-8"))
        return [content["imu"]] if "imu" in content else [member["id"] for member in content["imus"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="+", metavar="CAMPAIGN.toml", help="campaign files, one for each IMU; they name their samples")
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder of the tables, the reports and fleet.csv")
    parser.add_argument("--verify", metavar="FILE.csv", help="a recording next to each campaign file that judges its table")
    parser.add_argument("--require", default="factor=10", help="what --verify requires, as `isotherm verify --require` [default: %(default)s]")
    parser.add_argument("--workers", type=int, help="processes on this machine [default: one for each processor]")
    parser.add_argument("--scheduler", help="address of a running Dask scheduler; without one, workers start on this machine")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    folder = str(options.output.resolve())

    # Tables are named after their IMUs, so an IMU has one campaign.
    rows: list[dict[str, Any]] = []
    campaigns: list[str] = []
    first: dict[str, Any] = {}
    for name in options.campaigns:
        if twice := [imu for imu in imus(name) if imu in first]:
            message = f"{first[twice[0]]} is a campaign of {twice[0]} too; give one, or the other in a run of its own"
            rows.append({"campaign": name, "error": message})
            print(f"{name}: failed: {message}", file=sys.stderr)
        else:
            first |= dict.fromkeys(imus(name), name)
            campaigns.append(name)

    # Each worker is a process with one thread: a fit keeps one processor busy.
    if options.scheduler is None:
        client = Client(LocalCluster(n_workers=options.workers, threads_per_worker=1, processes=True, dashboard_address=""))
    else:
        client = Client(options.scheduler)
    with client:
        arguments = (folder, options.verify, options.require)
        jobs = {client.submit(make_table, str(Path(name).resolve()), *arguments, key=name, retries=0): name for name in campaigns}
        for job in as_completed(jobs):
            # A worker that died has no row.
            died = job.exception()
            row = job.result() if died is None else {"error": f"the worker died: {died}"}
            row["campaign"] = jobs[job]
            rows.append(row)
            if "error" in row:
                print(f"{jobs[job]}: failed: {row['error']}", file=sys.stderr, flush=True)
            else:
                print(f"{jobs[job]}: {row['accuracy']}", flush=True)

    places = {name: place for place, name in enumerate(options.campaigns)}
    rows.sort(key=lambda row: places[row["campaign"]])
    frame = pd.DataFrame(rows).set_index("campaign")
    frame.to_csv(options.output / "fleet.csv")
    failed = int(frame["error"].notna().sum()) if "error" in frame else 0
    print(f"{len(frame) - failed} tables, {failed} campaigns failed")
    tables = sorted(frame["table"].dropna()) if "table" in frame else []
    if len(tables) > 1:
        try:
            print(isotherm.batch(tables), end="")
        except isotherm.IsothermError as error:
            print(f"failed: {error}", file=sys.stderr)
            return 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
