"""Readings in, increments out: `fill`, `specific_force` and `angular_rate`."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys

import isotherm
import numpy as np
import pytest
from conftest import EXAMPLES, REPOSITORY, TIMEOUT, DomainUnderTest

MEMS_TABLE = REPOSITORY / "examples/tables/imu-mems.toml"
INTERVAL_NS = 2_500_000


def serve(domain: DomainUnderTest) -> None:
    shutil.copy(MEMS_TABLE, domain.folder)
    domain.spawn("--imu", f"imu-mems={domain.folder / MEMS_TABLE.name}").wait_until_ready()


def connected() -> isotherm.Acquisition:
    return isotherm.Acquisition("imu-mems", timeout=TIMEOUT, resolution=(1e-6, 1e-7))


def test_readings_become_pulses_without_a_loss(domain: DomainUnderTest) -> None:
    serve(domain)
    pulses = np.zeros(2)
    with connected() as acquisition:
        for _ in range(1000):
            loan = acquisition.loan()
            acquisition.fill(loan, [0.0, -1.000_000_3, 0.0], np.array([0.0, 0.0, 2.000_000_04]))
            assert loan.interval_ns == INTERVAL_NS
            pulses += loan.accelerometers.negative_pulses[1], loan.gyroscopes.positive_pulses[2]
            loan.cancel()
        assert pulses.tolist() == [1_000_000_300, 20_000_000_400]
        loan = acquisition.loan()
        loan.interval_ns = 2 * INTERVAL_NS
        acquisition.fill(loan, (1.0, 0.0, 0.0))
        assert loan.accelerometers.positive_pulses == (2_000_000, 0, 0)
        assert math.isnan(loan.gyroscopes.head_temperature[0]), "no reading"
        loan.cancel()


def test_what_is_refused_changes_nothing(domain: DomainUnderTest) -> None:
    serve(domain)
    with connected() as acquisition:
        loan = acquisition.loan()
        acquisition.fill(loan, (0.000_000_3, 0.0, 0.0), (0.0, 0.0, 0.0))
        for force, rate, message in (
            ((0.0, math.nan, 0.0), (0.0, 0.0, 0.0), "A2: the reading is NaN"),
            ((0.0, 0.0, 0.0), (-math.inf, 0.0, 0.0), "G1: the reading is -inf"),
            ((0.0, 0.0, 4295.0), (0.0, 0.0, 0.0), "A3: the reading 4295 is over 4294967295 pulses"),
            ((0.0, 0.0), (0.0, 0.0, 0.0), "specific_force is .*, give three numbers"),
        ):
            before = loan.to_numpy().tobytes()
            with pytest.raises(ValueError, match=message):
                acquisition.fill(loan, force, rate)
            assert loan.to_numpy().tobytes() == before
        acquisition.fill(loan, (0.000_000_3, 0.0, 0.0), (0.0, 0.0, 0.0))
        assert loan.accelerometers.positive_pulses[0] == 1, "the remainder of the first one"
        loan.cancel()
        with pytest.raises(isotherm.Closed):
            acquisition.fill(loan, (0.0, 0.0, 0.0))
    with isotherm.Acquisition("imu-mems", timeout=TIMEOUT) as acquisition, pytest.raises(ValueError, match="resolution"):
        acquisition.fill(acquisition.loan(), (0.0, 0.0, 0.0))
    for resolution in ((1e-5, 1e-7), (1e-6, math.nan)):
        with pytest.raises(isotherm.IsothermError, match="one pulse of the source"):
            isotherm.Acquisition("imu-mems", timeout=TIMEOUT, resolution=resolution)


def test_the_example_gives_compensated_readings(domain: DomainUnderTest) -> None:
    serve(domain)
    command = [sys.executable, str(EXAMPLES / "mems.py"), "--samples", "20"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    table = isotherm.Table.load(MEMS_TABLE)
    assert table.gyroscopes is not None and table.axes[0].bias.unit == "mg0"
    lines = done.stdout.splitlines()
    assert len(lines) == 20
    for number, line in enumerate(lines):
        words = line.replace(":", "").split()
        assert (int(words[0]), words[4], words[8]) == (number, "m/s2,", "rad/s")
        turn = number / 7.0
        force = np.array([0.1234567, -0.2345678 - turn, 9.8012345])
        rate = np.array([0.01234567, -turn, 0.00001234])
        # By hand: the scale factor's error, and the bias.
        for axis in range(3):
            sensor, gyroscope = table.axes[axis], table.gyroscopes[axis]
            size = 9.80665 / (1e-6 * 0.0025) / sensor.positive_scale_factor(31.25)
            assert float(words[1 + axis]) == pytest.approx(force[axis] * size - sensor.bias(31.25) * 9.80665e-3, abs=2e-6)
            size = math.pi / 648_000 / (1e-7 * 0.0025) / gyroscope.positive_scale_factor(31.25)
            bias = gyroscope.bias(31.25) * math.pi / 648_000
            assert float(words[5 + axis]) == pytest.approx(rate[axis] * size - bias, abs=2e-7)
