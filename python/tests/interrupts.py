"""Measures the time from SIGINT to KeyboardInterrupt in long functions, as docs/figures.md has it:

    python3 python/tests/interrupts.py
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
# Each job runs again until the signal comes.
JOBS = {
    "calibrate_turntable": f"isotherm.calibrate_turntable({str(REPOSITORY / 'examples/campaign/campaign.toml')!r})",
    "calibrate_turntable, gyroscopes": f"isotherm.calibrate_turntable({str(REPOSITORY / 'calibration/fit/tests/data/gyro/campaign.toml')!r})",
    "calibrate_warm_up": f"isotherm.calibrate_warm_up({str(REPOSITORY / 'recording/formats/tests/data/autopilots/heating.BIN')!r}, 'a')",
    "verify, 500 000 rows": "isotherm.verify(table, rows)",
    "replay, 500 000 rows": "isotherm.replay(table, rows)",
    "noise, 500 000 rows": "isotherm.noise(rows)",
    "noise, 4 000 000 rates": "isotherm.noise(rates, interval=0.01)",
}
CODE = f"""
import sys, time, warnings
import numpy as np, isotherm
warnings.simplefilter("ignore")
table = isotherm.Table.load({str(REPOSITORY / "tests/data/imu-a.toml")!r})
random = np.random.default_rng(1)
rates = random.normal(size=4_000_000)
rows = np.zeros(500_000, isotherm.RAW_SAMPLE)
rows["sequence"] = np.arange(len(rows))
rows["interval_ns"] = 2_500_000
rows["timestamp_ns"] = 2_500_000 * (1 + rows["sequence"])
triad = rows["accelerometers"]
triad["positive_pulses"] = 140 + random.integers(0, 3, (len(rows), 3))
triad["head_temperature"] = triad["board_temperature"] = 2.5
print("ready", flush=True)
try:
    while True:
        try:
            JOB
        except isotherm.IsothermError:
            pass
except KeyboardInterrupt:
    print(time.monotonic(), flush=True)
"""


def main() -> None:
    draw = random.Random(1)
    for name, job in JOBS.items():
        waits = []
        for _ in range(int(sys.argv[1]) if len(sys.argv) > 1 else 20):
            with subprocess.Popen([sys.executable, "-c", CODE.replace("JOB", job)], stdout=subprocess.PIPE, text=True) as child:
                assert child.stdout is not None and child.stdout.readline() == "ready\n"
                time.sleep(draw.uniform(0.05, 2.0))
                sent = time.monotonic()
                child.send_signal(signal.SIGINT)
                waits.append(float(child.stdout.readline()) - sent)
        waits.sort()
        print(f"{name}: median {waits[len(waits) // 2] * 1e3:.0f} ms, largest {waits[-1] * 1e3:.0f} ms", flush=True)


if __name__ == "__main__":
    main()
