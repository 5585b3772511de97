"""What a user writes, for the type checkers: mypy --strict and pyright pass on it."""

from __future__ import annotations

import asyncio
import pickle

import isotherm
import numpy as np


def offline() -> tuple[float, float, float]:
    calibration = isotherm.calibrate_turntable("campaign.toml", order=3, exclude=[(-25.0, 3)], alignment=True)
    table: isotherm.Table = calibration.table
    line = isotherm.Polynomial([1.5, 2.0], unit="mg0")
    value: float = line(2.0) + table.axes[0].bias(2.5)
    values = table.axes[0].bias(np.linspace(1.2, 3.8, 5))
    print(value, values.mean(), calibration.residuals.std(axis=0), pickle.loads(pickle.dumps(table)) == table)
    try:
        samples = isotherm.read_recording("run.csv")
    except isotherm.RecordingFault as fault:
        raise SystemExit(f"line {fault.line}: {fault}") from fault
    increments = isotherm.replay(table, samples)
    print(increments["velocity_increment"].sum())
    return isotherm.verify(table, samples, attitude=(0.6, -0.48, 0.64)).factor


async def read() -> None:
    with isotherm.IncrementReader("imu-a", timeout=None) as reader:
        async for increment in reader:
            print(increment.velocity_increment[0], isotherm.flag_names(increment.flags), reader.heartbeat_age() < 1.0)


def acquire() -> None:
    with isotherm.Acquisition("imu-a", lag=240.0) as acquisition:
        sample = acquisition.loan()
        sample.accelerometers.positive_pulses = (140, 0, 150)
        sample.accelerometers.head_temperature = np.array([2.5, 2.5, 2.5])
        increment: isotherm.Increment = acquisition.compensate(sample)
        print(increment.specific_force)


if __name__ == "__main__":
    print(offline())
    acquire()
    asyncio.run(read())
