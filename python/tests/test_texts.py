"""Every public name has a text at run time; each function and class has an example that runs."""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
import subprocess
import sys

import isotherm
import numpy as np
import pytest
from conftest import BINARY, CAMPAIGN, REPOSITORY, RUN, TABLE, DomainUnderTest

EXCEPTIONS = [name for name in isotherm.__all__ if inspect.isclass(of := getattr(isotherm, name)) and issubclass(of, Exception)]
CALLED = [name for name in isotherm.__all__ if callable(getattr(isotherm, name)) and name not in EXCEPTIONS and name != "Records"]


@pytest.mark.parametrize("name", [*CALLED, *EXCEPTIONS])
def test_every_member_has_a_text(name: str) -> None:
    value = getattr(isotherm, name)
    assert value.__doc__
    for inner, of in vars(value).items() if inspect.isclass(value) and name != "Flags" else ():
        assert inner.startswith("_") or of.__doc__, f"{name}.{inner}"


def test_examples_run(domain: DomainUnderTest, monkeypatch: pytest.MonkeyPatch) -> None:
    domain.serve()
    monkeypatch.chdir(domain.folder)
    shutil.copytree(CAMPAIGN.parent, "campaign")
    shutil.copy(RUN, "run.csv")
    shutil.copy(REPOSITORY / "calibration/fit/tests/data/any_lab/xsens/recording.csv", "tumble.csv")
    shutil.copy(REPOSITORY / "recording/formats/tests/data/autopilots/heating.BIN", "warm-up.BIN")
    other = re.sub(r"^digest = .*\n", "", TABLE.read_text(), flags=re.MULTILINE).replace('"imu-a"', '"imu-b"')
    (domain.folder / "imu-b.toml").write_text(other)
    domain.isotherm("simulate", "run", "-o", "simulated", "--interval", "1")
    shutil.copy("simulated/run.csv", "still.csv")
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for name in CALLED:
        test = doctest.DocTestParser().get_doctest(getattr(isotherm, name).__doc__, {"isotherm": isotherm, "np": np}, name, None, 0)
        assert test.examples, f"isotherm.{name} has no example"
        runner.run(test, out=sys.stderr.write)
    assert runner.summarize(verbose=False).failed == 0


def test_stub_and_page_have_these_texts() -> None:
    check = subprocess.run([sys.executable, REPOSITORY / "python/reference.py", "--check"], capture_output=True, text=True, timeout=60)
    assert check.returncode == 0, check.stderr
