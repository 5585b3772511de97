"""Calibrates hundreds of campaigns on all processors, or on the machines of a Dask cluster.

    python3 fleet.py lot-7/*/campaign.toml -o tables --workers 8
    python3 fleet.py lot-7/*/campaign.toml -o tables --scheduler tcp://10.0.0.1:8786

Needs `pip install 'dask[distributed]'`. Each campaign gives TABLE.toml and TABLE.html, named after its IMU. A campaign that fails is reported with
its reason, and the others go on; then the exit code is 1. A second campaign of an IMU fails, because its table would replace the first one's. Workers on
other machines must see the same files.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path

import isotherm
from dask.distributed import Client, LocalCluster, as_completed


def make_table(campaign: str, folder: str) -> tuple[str, str]:
    """Runs in a worker. Returns the table's file, and what was reached."""
    calibration = isotherm.calibrate_turntable(campaign)
    table = Path(folder) / f"{calibration.table.imu}.toml"
    calibration.save(table, report=table.with_suffix(".html"))
    return str(table), calibration.accuracy


def imus(campaign: str) -> list[str]:
    """The IMUs that a campaign file names. None if it cannot be read: the worker that tries tells why."""
    try:
        content = tomllib.loads(Path(campaign).read_text(encoding="utf-8"))
        return [content["imu"]] if "imu" in content else [member["id"] for member in content["imus"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="+", metavar="CAMPAIGN.toml", help="campaign files, one for each IMU; they name their samples")
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder of the tables and reports")
    parser.add_argument("--workers", type=int, help="processes on this machine [default: one for each processor]")
    parser.add_argument("--scheduler", help="address of a running Dask scheduler; without one, workers start on this machine")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    folder = str(options.output.resolve())

    # Tables are named after their IMUs, so an IMU has one campaign.
    campaigns: list[str] = []
    first: dict[str, object] = {}
    failed = 0
    for name in options.campaigns:
        if twice := [imu for imu in imus(name) if imu in first]:
            failed += 1
            print(f"{name}: failed: {first[twice[0]]} is a campaign of {twice[0]} too; give one, or the other in a run of its own", file=sys.stderr)
        else:
            first |= dict.fromkeys(imus(name), name)
            campaigns.append(name)

    # Each worker is a process with one thread: a fit keeps one processor busy.
    if options.scheduler is None:
        client = Client(LocalCluster(n_workers=options.workers, threads_per_worker=1, processes=True, dashboard_address=""))
    else:
        client = Client(options.scheduler)
    with client:
        jobs = {client.submit(make_table, str(Path(name).resolve()), folder, key=f"{name}", retries=0): name for name in campaigns}
        tables = []
        for job in as_completed(jobs):
            error = job.exception()
            if error is None:
                table, accuracy = job.result()
                tables.append(table)
                print(f"{jobs[job]}: {accuracy}", flush=True)
            else:
                failed += 1
                print(f"{jobs[job]}: failed: {error}", file=sys.stderr, flush=True)
    print(f"{len(tables)} tables, {failed} campaigns failed")
    if len(tables) > 1:
        try:
            print(isotherm.batch(sorted(tables)), end="")
        except isotherm.IsothermError as error:
            print(f"failed: {error}", file=sys.stderr)
            return 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
