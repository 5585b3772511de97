"""What a notebook shows of results: their first screens, figures, values with intervals; progress, and Ctrl-C."""

from __future__ import annotations

import copy
import json
import pickle
import re
import signal
import subprocess
import sys
from html import unescape
from pathlib import Path
from typing import Any

import isotherm
import matplotlib
import numpy as np
import pytest
from conftest import CAMPAIGN, REPOSITORY, RUN, TABLE, WHOLE_CAMPAIGN

matplotlib.use("Agg")
LOG = REPOSITORY / "recording/formats/tests/data/autopilots/heating.BIN"


@pytest.fixture(scope="module")
def calibration() -> isotherm.Calibration:
    return isotherm.calibrate_turntable(CAMPAIGN)


def still(rows: int = 20_000) -> np.ndarray:
    """A recording at rest with white noise in the counts."""
    random = np.random.default_rng(3)
    samples = np.zeros(rows, isotherm.RAW_SAMPLE)
    samples["sequence"] = np.arange(rows)
    samples["interval_ns"] = 10_000_000
    samples["timestamp_ns"] = 10_000_000 * (1 + samples["sequence"])
    triad = samples["accelerometers"]
    triad["positive_pulses"] = 1000 + random.integers(-5, 6, (rows, 3))
    triad["head_temperature"] = triad["board_temperature"] = 2.5
    return samples


def screen(result: Any) -> str:
    """The document in the frame that a notebook shows. Nothing is outside of it."""
    html = result._repr_html_()
    frame = re.fullmatch(r'<iframe srcdoc="([^"<>]*)" sandbox="" style="[^"]*"></iframe>', html)
    assert frame is not None, html[:200]
    return unescape(frame[1])


def test_each_result_shows_the_first_screen_of_its_report(calibration: isotherm.Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "table.toml", report=tmp_path / "calibration.html")
    assert calibration.html() == (tmp_path / "calibration.html").read_text()
    table = isotherm.Table.load(TABLE)
    still_table = isotherm.verify(table, isotherm.read_recording(RUN), window=0.01)
    warm = isotherm.calibrate_vehicle(LOG, "imu-c", lag="none")
    results: dict[str, Any] = {
        "Calibration of imu-paper": calibration,
        "Table of imu-paper": calibration.table,
        "Stability": still_table,
        "Comparison": isotherm.compare(calibration, calibration.table, other_device=True),
        "Noise of": isotherm.noise(still()),
        "Noise of rates": isotherm.noise(np.random.default_rng(1).normal(size=2000), interval=0.1),
        "Calibration of": next(iter(warm.values())),
    }
    for title, result in results.items():
        shown = screen(result)
        assert title in shown and "<svg" in result.html(), title
        assert shown.count("<h2") == 1 and "<nav" not in shown and len(shown) <= len(result.html()), title
    assert warm._repr_html_().count("<iframe") == len(warm)


def test_names_of_files_stay_text() -> None:
    evil = '</iframe><script>alert("1")</script>'
    found = isotherm.noise(still(), recording=evil)
    assert "<script" not in found._repr_html_() and "<script" not in screen(found)
    assert found._repr_html_().count("<") == 2


def test_values_have_the_intervals_of_the_report(calibration: isotherm.Calibration) -> None:
    curve = calibration.curves["A1", "bias"]
    low, high = curve.range
    value = curve.at(0.5 * (low + high))
    assert value.interval is not None and value.interval[0] < value.value < value.interval[1]
    assert (curve.unit, float(value)) == ("ug0", value.value)
    assert calibration.table.axes[0].bias(0.5 * (low + high)) == pytest.approx(value.value, rel=1e-9)
    at = np.linspace(low, high, 121)
    # The largest of each curve is what the summary says.
    for axis in calibration.summary["axes"]:
        own = calibration.curves[axis["axis"], "bias"]
        inside = own.at(np.linspace(*own.range, 121))
        assert float(np.max(inside.high - inside.low)) / 2 == pytest.approx(axis["bias_interval_g0"] * 1e6, rel=1e-6)
    band = curve.band(at)
    assert np.all(band.high - band.low > curve.at(at).high - curve.at(at).low)
    # Out of the measured temperature no interval is known.
    assert curve.at(high + 1.0).interval is None
    # A table that is read again has them from its provenance.
    again = isotherm.Table.parse(calibration.text).curves["A1", "bias"].at(0.5 * (low + high))
    assert again.interval == pytest.approx(value.interval, rel=1e-6)
    assert curve.points.shape == (15, 3)
    assert set(isotherm.calibrate_turntable(WHOLE_CAMPAIGN).curves) == {
        (sensor, quantity) for sensor in ("A1", "A2", "A3", "G1", "G2", "G3") for quantity in ("bias", "positive_scale_factor", "negative_scale_factor")
    }
    by_hand = isotherm.Table.load(TABLE).curves["A1", "bias"]
    assert by_hand.at(2.5).interval is None


def test_residuals_as_a_frame(calibration: isotherm.Calibration) -> None:
    frame = calibration.residuals_frame()
    assert len(frame) == 3 * len(calibration.dwells)
    assert frame[frame["sensor"] == "A2"]["residual"].to_numpy().tolist() == calibration.residuals[:, 1].tolist()


def test_noise_is_the_document_and_has_names() -> None:
    found = isotherm.noise(still())
    assert found["sensors"][0]["axis"] == "A1" and json.loads(json.dumps(found)) == found
    white = found["A1"].N
    coefficients = {each["letter"]: each for each in found["sensors"][0]["model"]["coefficients"]}
    assert white is not None and white.value == coefficients["N"]["value_in_unit"]
    assert white.interval == tuple(coefficients["N"]["range_in_unit"])
    with pytest.raises(KeyError):
        found["A4"]
    assert "A4" not in found and found.get("A1") is None
    for same in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert same == found and same.html() == found.html() and same["A1"].N == white
    rates = isotherm.noise(np.random.default_rng(1).normal(size=20_000), interval=0.01)
    assert rates.N is not None and rates.N.value == pytest.approx(0.1, rel=0.1)


def test_a_table_is_saved_sealed(calibration: isotherm.Calibration, tmp_path: Path) -> None:
    calibration.table.save(tmp_path / "a.toml")
    assert (tmp_path / "a.toml").read_text() == calibration.text
    # One that was written by hand gets its digest; a provenance stays.
    text = re.sub(r"(?m)^digest.*\n", "", TABLE.read_text()) + '\n[provenance]\nby = "hand"\n'
    isotherm.Table.parse(text).save(tmp_path / "b.toml")
    saved = (tmp_path / "b.toml").read_text()
    assert f'digest = "{isotherm.Table.load(TABLE).digest}"' in saved and saved.endswith('[provenance]\nby = "hand"\n')
    assert isotherm.Table.load(tmp_path / "b.toml") == isotherm.Table.load(TABLE)


def test_plots(calibration: isotherm.Calibration) -> None:
    from matplotlib import pyplot

    axes = calibration.plot()
    assert axes.shape == (3, 3) and axes[0, 0].get_title() == "bias of A1" and len(axes[0, 0].collections) >= 1
    assert calibration.plot("residuals").shape == (3, 3) and calibration.plot("dwells").shape == (3,)
    assert calibration.table.plot().shape == (3, 3)
    stability = isotherm.verify(isotherm.Table.load(TABLE), isotherm.read_recording(RUN), window=0.01)
    assert [line.get_label() for line in stability.plot()[0].lines[:2]] == ["before", "after"]
    noise = isotherm.noise(still()).plot()[0]
    assert noise.get_xscale() == "log" and [line.get_label() for line in noise.lines] == ["measured", "model"]
    assert len(isotherm.compare(calibration, calibration.table, other_device=True).plot()) == 9
    figure, own = pyplot.subplots(3, 1)
    assert stability.plot(axes=own)[2] is own[2]
    with pytest.raises(ValueError, match="1 axes are given, 3 are needed"):
        stability.plot(axes=own[0])
    with pytest.raises(ValueError, match="kind is 'x'"):
        calibration.plot("x")  # type: ignore[arg-type]
    pyplot.close("all")


def test_without_matplotlib_plot_says_what_to_install() -> None:
    code = f"""
import sys
sys.modules["matplotlib"] = None
import isotherm
try:
    isotherm.Table.load({str(TABLE)!r}).plot()
except ImportError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "plot() needs matplotlib: pip install matplotlib, or pip install 'isotherm[plot]'\n", done.stderr


def test_progress_goes_from_nothing_to_all() -> None:
    seen: list[tuple[int, int]] = []
    samples = still()
    isotherm.noise(samples, progress=lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen) and seen[-1] == (len(samples), len(samples))
    seen.clear()
    isotherm.calibrate_turntable(CAMPAIGN, progress=lambda done, total: seen.append((done, total)))
    size = (CAMPAIGN.parent / "samples.csv").stat().st_size
    assert seen == sorted(seen) and seen[-1] == (size, size)
    with pytest.raises(TypeError, match="progress is 3"):
        isotherm.noise(samples, progress=3)  # type: ignore[call-overload]


def test_progress_of_tqdm(capsys: pytest.CaptureFixture[str]) -> None:
    isotherm.noise(still(), progress=True)
    assert "noise: 100%" in capsys.readouterr().err


def test_an_exception_in_progress_ends_the_work() -> None:
    def stop(done: int, total: int) -> None:
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        isotherm.replay(isotherm.Table.load(TABLE), isotherm.read_recording(RUN), progress=stop)
    # Nothing is left of it.
    isotherm.replay(isotherm.Table.load(TABLE), isotherm.read_recording(RUN))


@pytest.mark.parametrize(
    "job",
    [
        f"isotherm.calibrate_turntable({str(CAMPAIGN)!r})",
        f"isotherm.calibrate_warm_up({str(LOG)!r}, 'imu-c')",
        "isotherm.noise(rates, interval=0.01)",
    ],
)
def test_ctrl_c_ends_the_work(job: str, tmp_path: Path) -> None:
    """The work runs again and again, so the signal comes in the middle of it; the process can work afterwards."""
    code = f"""
import numpy as np, isotherm
rates = np.random.default_rng(1).normal(size=200_000)
try:
    print("begins", flush=True)
    while True:
        {job}
except KeyboardInterrupt:
    print("ended", flush=True)
{job}
print("works")
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as child:
        assert child.stdout is not None and child.stdout.readline() == "begins\n"
        child.send_signal(signal.SIGINT)
        out, error = child.communicate(timeout=120)
    assert (out, error, child.returncode) == ("ended\nworks\n", "", 0)
    assert list(tmp_path.iterdir()) == []


def test_the_tour_shows_what_its_file_has() -> None:
    """Every cell runs without an error, and prints what the shipped file has of it."""
    sys.path.insert(0, str(REPOSITORY / "python"))
    import tour

    assert tour.PATH.stat().st_size < 500_000
    before, now = tour.run()
    assert tour.shown(now) == tour.shown(before)
