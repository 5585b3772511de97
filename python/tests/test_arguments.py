"""Wrong arguments are named, with what they may be, in the words of Python."""

from __future__ import annotations

from typing import Any

import isotherm
import numpy as np
import pytest
from conftest import CAMPAIGN, REPOSITORY, TABLE, TIMEOUT, DomainUnderTest
from isotherm._errors import in_python

XSENS = REPOSITORY / "calibration/fit/tests/data/any_lab/xsens/recording.csv"
AT_HOME = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}


@pytest.mark.parametrize(
    "given, kind, message",
    [
        ({"order": "cubic"}, ValueError, "order is 'cubic', give \"auto\" or a whole number from 0 to 7"),
        ({"order": 9}, ValueError, "order is 9, give \"auto\" or a whole number from 0 to 7"),
        ({"exclude": (-25.0, 3)}, ValueError, "exclude is (-25.0, 3), give pairs (set point [degC], number) in a list, for example [(-25.0, 3)]"),
        ({"method": "three"}, ValueError, 'method is "three", give "one-stage" or "two-stage"'),
        ({"alignment": "yes"}, TypeError, "alignment is 'yes', give True, False or None"),
        ({"strict": 1.0}, TypeError, "strict is 1.0, give True or False"),
        ({"accept": [3]}, TypeError, "accept has 3, give a list of texts"),
        ({"accept": "foo"}, ValueError, "accept: give the name of a finding: "),
        ({"lag": "some"}, TypeError, "lag is 'some', give a time constant in s, \"none\" or None"),
        ({"imu": 3}, TypeError, "imu is 3, give the name of an IMU"),
        ({"start": "soon"}, ValueError, "start is soon: give seconds"),
    ],
)
def test_of_a_campaign(given: dict[str, Any], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as raised:
        isotherm.calibrate_turntable(CAMPAIGN, **given)
    assert str(raised.value).startswith(message)


@pytest.mark.parametrize(
    "given, kind, message",
    [
        ({"exclude": [0]}, ValueError, "exclude is [0], give numbers of static poses from 1"),
        ({"exclude": 12}, ValueError, "exclude is 12, give numbers of static poses from 1"),
        ({"temperature_range": 3}, TypeError, "temperature_range is 3, give its lower and its upper end"),
        ({"misalignment": "no"}, TypeError, "misalignment is 'no', give True or False"),
        ({"window": "1 s"}, TypeError, "window is '1 s', give a number"),
        ({"interval": "1 s"}, TypeError, "interval is '1 s', give a number"),
    ],
)
def test_of_a_tumble(given: dict[str, Any], kind: type[Exception], message: str) -> None:
    with pytest.raises(kind) as raised:
        isotherm.calibrate_tumble(AT_HOME, XSENS, **given)
    assert str(raised.value).startswith(message)


def test_options_of_the_command_become_arguments() -> None:
    said = {
        "or give --order 0.": "or give order=0.",
        "out with --exclude -25/3": "out with exclude=[(-25, 3)]",
        "--accept not-covered": 'accept=["not-covered"]',
        "state --attitude, and --gravity-local or": "state attitude, and gravity_local or",
        "see `isotherm import x --from px4`": "see `isotherm import x --from px4`",
        "with --from and --to": "with start and end",
        "--other-device makes": "other_device=True makes",
        "as --require bias=20ug0": 'as require="bias=20ug0"',
    }
    for command, python in said.items():
        assert in_python(command) == python and in_python(python) == python
    with pytest.raises(isotherm.CalibrationError) as raised:
        isotherm.calibrate_tumble(AT_HOME, XSENS)
    assert "temperature_range" in str(raised.value) and "--" not in str(raised.value)
    ferraris = REPOSITORY / "calibration/fit/tests/data/any_lab/ferraris/recording.csv"
    with pytest.raises(isotherm.CalibrationError, match="misalignment=False"):
        isotherm.calibrate_tumble(AT_HOME, ferraris, temperature_range=(0.0, 50.0))
    with pytest.raises(ValueError, match="device_id"):
        isotherm.export_parameters(isotherm.Table.load(TABLE), to="px4")


def test_of_a_loan(domain: DomainUnderTest) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        triad = acquisition.loan().accelerometers
        for pulses, kind in (((-3, 0, 0), ValueError), ((1, 2), ValueError), ((2**32, 0, 0), ValueError), ((1.5, 0, 0), TypeError), (3, TypeError)):
            with pytest.raises(kind) as raised:
                triad.positive_pulses = pulses  # type: ignore[assignment]
            assert f"positive_pulses is {pulses}, give three whole numbers from 0 to 4294967295" in str(raised.value)
        with pytest.raises(TypeError, match="head_temperature is .*, give three numbers"):
            triad.head_temperature = ("a", 0.0, 0.0)  # type: ignore[assignment]


def test_a_polynomial_is_made_of_its_coefficients() -> None:
    line = isotherm.Polynomial([1.5, 2.0])
    assert line(2.0) == 5.5 and line.range == (-np.inf, np.inf) and (line.center, line.scale, line.unit) == (0.0, 1.0, "")
    assert line(np.array([[0.0, 1.0]])).tolist() == [[1.5, 3.5]]
    bias = isotherm.Table.load(TABLE).axes[0].bias
    again = isotherm.Polynomial(bias.coefficients, center=bias.center, scale=bias.scale, range=bias.range, unit=bias.unit)
    assert again == bias and again != line and len({again, bias, line}) == 2
    for coefficients in ([], [np.nan], [1.0] * 9):
        with pytest.raises(ValueError, match="coefficients are .*give 1 to 8 finite coefficients"):
            isotherm.Polynomial(coefficients)
