#!/usr/bin/env python3
"""Makes the pictures of the documents, docs/pictures/*.svg, with the command `isotherm` that is on PATH.

    cargo build --release && PATH=$PWD/target/release:$PATH python3 docs/pictures.py

Names make some of them. `--check` compares them with the files in place of writing them. The same version makes the same
files on every machine.
"""

import argparse
import csv
import functools
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from chart import Drawing, Plot, Points, span

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs/pictures"
PICTURES: dict[str, Callable[[], str]] = {}


def picture(name: str) -> Callable[[Callable[[], str]], Callable[[], str]]:
    def keep(made: Callable[[], str]) -> Callable[[], str]:
        PICTURES[name] = made
        return made

    return keep


@functools.cache
def scratch() -> Path:
    """A folder for what the commands write."""
    kept = tempfile.TemporaryDirectory(prefix="isotherm-pictures-")
    scratch.kept = kept  # type: ignore[attr-defined]
    return Path(kept.name)


@functools.cache
def isotherm(*words: str, fails: bool = False) -> str:
    """What the command prints. It runs once for the same words, in the scratch folder."""
    ended = subprocess.run(["isotherm", *words], cwd=scratch(), capture_output=True, text=True)
    if (ended.returncode != 0) != fails:
        sys.exit(f"isotherm {' '.join(words)}: exit code {ended.returncode}\n{ended.stderr}")
    return ended.stdout


# The real thermal run.

CONSUMER = ROOT / "calibration/fit/tests/data/consumer"
# A cooling and a heating end here, and the cooling that is judged begins [s].
FITTED_S = 3129.6
# A3 and G2 by their names in a vehicle, with the factor from m/s or rad and the unit.
SENSORS = {"a3_dv": ("accelerometer Z", "mm/s²"), "g2_da": ("gyroscope Y", "mrad/s")}
GIVEN_LAG_S = "100"


def warm_up_table(lag: str) -> dict:
    """Writes LAG.toml from the cooling and the heating, and returns the command's result."""
    words = ["calibrate", "warm-up", f"{CONSUMER}/thermal-run.csv", "--nominal", f"{CONSUMER}/nominal.toml", "--imu", "consumer"]
    words += ["--to", str(FITTED_S), "--lag", lag, "--beside", "px4", "--json", "-o", f"{lag}.toml"]
    return json.loads(isotherm(*words))


@functools.cache
def thermal_run(table: str) -> dict[str, list[tuple[float, float, bool]]]:
    """Of each sensor the temperature and the reading under a table [mm/s2, mrad/s], and whether it was fitted."""
    isotherm("replay", "--table", table, f"{CONSUMER}/thermal-run.csv", "-o", "increments.csv")
    with open(scratch() / "increments.csv") as increments, open(CONSUMER / "thermal-run.csv") as raw:
        rows = list(zip(csv.DictReader(increments), csv.DictReader(raw), strict=True))
    begin = int(rows[0][1]["timestamp_ns"])
    return {
        sensor: [
            (
                float(sample["a1_head"]),
                float(increment[sensor]) / int(sample["interval_ns"]) * 1e12,
                int(sample["timestamp_ns"]) - begin <= FITTED_S * 1e9,
            )
            for increment, sample in rows
        ]
        for sensor in SENSORS
    }


def bins(rows: list[tuple[float, float]]) -> Points:
    """Means of temperature and reading over bins of 1 degC."""
    sums: dict[int, list[float]] = {}
    for temperature, reading in rows:
        of = sums.setdefault(int(temperature // 1), [0.0, 0.0, 0.0])
        of[0] += temperature
        of[1] += reading
        of[2] += 1
    return [(t / n, reading / n) for _, (t, reading, n) in sorted(sums.items())]


def mean(points: Points) -> float:
    return sum(reading for _, reading in points) / len(points)


def judged(table: str, sensor: str) -> Points:
    """The bins of the cooling that was not fitted, about the mean of the bins that were."""
    rows = thermal_run(table)[sensor]
    middle = mean(bins([(t, reading) for t, reading, fitted in rows if fitted]))
    return [(t, reading - middle) for t, reading in bins([(t, reading) for t, reading, fitted in rows if not fitted])]


def rms(points: Points) -> str:
    value = (sum(reading**2 for _, reading in points) / len(points)) ** 0.5
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"


@picture("thermal-run")
def _() -> str:
    warm_up_table(GIVEN_LAG_S)
    drawing = Drawing("Readings of a real consumer IMU over temperature, raw and compensated")
    drawing.heading(
        "A consumer IMU: raw, and compensated",
        "Real recording at rest. The table was fitted to a cooling and a heating.",
        "This is the next cooling, which was not fitted.",
    )
    drawing.keys([("raw-line wide", "raw"), ("own-line wide", f"compensated by Isotherm, with a lag of {GIVEN_LAG_S} s")])
    for sensor, (name, unit) in SENSORS.items():
        raw, own = judged(str(CONSUMER / "nominal.toml"), sensor), judged(f"{GIVEN_LAG_S}.toml", sensor)
        drawing.heading(f"{name}: {rms(raw)} → {rms(own)} {unit} rms")
        plot = Plot(drawing, (32, 75), span([raw, own]), 170, "temperature [°C]", f"deviation [{unit}]")
        plot.line(raw, "raw-line wide")
        plot.line(own, "own-line wide")
    return drawing.svg()


def cubic(points: Points) -> Callable[[float], float]:
    """The least-squares cubic, of temperatures in units of 40 degC about 30."""
    rows = [[((t - 30) / 40) ** power for power in range(4)] + [reading] for t, reading in points]
    normal = [[sum(row[i] * row[j] for row in rows) for j in range(5)] for i in range(4)]
    for i in range(4):
        for k in range(4):
            if k != i:
                factor = normal[k][i] / normal[i][i]
                normal[k] = [a - factor * b for a, b in zip(normal[k], normal[i], strict=True)]
    coefficients = [normal[i][4] / normal[i][i] for i in range(4)]
    return lambda t: sum(c * ((t - 30) / 40) ** power for power, c in enumerate(coefficients))


@picture("warm-up")
def _() -> str:
    found = warm_up_table("none")
    warm_up_table(GIVEN_LAG_S)
    sensor = "a3_dv"
    nominal = str(CONSUMER / "nominal.toml")
    fitted = [(t, reading) for t, reading, fitted in thermal_run(nominal)[sensor] if fitted]
    own = [(t, reading) for t, reading, fitted in thermal_run("none.toml")[sensor] if fitted]
    middle = mean(bins(fitted))
    # PX4's script fits a cubic in which each temperature weighs alike. The command states what its own copy leaves.
    curve = cubic(bins(fitted))
    left = [(t, reading - curve(t)) for t, reading in bins(fitted)]
    stated = next(b for b in found["biases"] if b["name"] == "A3")["beside"][0]["after"]["standard_deviation"] * 1e3
    rest = (sum(reading**2 for _, reading in left) / len(left)) ** 0.5
    assert abs(rest / stated - 1) < 0.02, (rest, stated)

    drawing = Drawing("A warm-up: raw, corrected by PX4's cubic and by Isotherm, and the difference of the two")
    drawing.heading(
        "A warm-up of a consumer IMU, accelerometer Z",
        "Real recording at rest. Both curves are fitted to the",
        "same rows: a cooling and a heating.",
    )
    drawing.keys([("raw-line wide faint", "raw"), ("other-line wide", "PX4's method: a cubic"), ("own-line wide dashed", "Isotherm, without a lag")])
    thinned = [(t, reading - middle) for t, reading in fitted[::12]]
    own_curve = bins([(t, reading - corrected) for (t, reading), (_, corrected) in zip(fitted, own, strict=True)])
    shift = mean(own_curve)
    own_curve = [(t, reading - shift) for t, reading in own_curve]
    px4_curve = [(t, curve(t) - middle) for t, _ in own_curve]
    plot = Plot(drawing, (-20, 76), span([thinned]), 170, "temperature [°C]", "deviation [mm/s²]")
    plot.dots(thinned, "raw-line faint", 3)
    plot.line(px4_curve, "other-line wide")
    plot.line(own_curve, "own-line wide dashed")

    difference = [(t, ours - theirs) for (t, ours), (_, theirs) in zip(own_curve, px4_curve, strict=True)]
    largest = max(abs(reading) for _, reading in difference)
    drawing.heading(f"Isotherm less PX4's cubic: {largest:.1f} mm/s² at most")
    plot = Plot(drawing, (-20, 76), (-2, 2), 80, "temperature [°C]", "[mm/s²]")
    plot.line(difference, "third-line wide")

    drawing.heading("What is left on the next cooling, which was not fitted")
    theirs = [(t, reading - curve(t)) for t, reading, fitted in thermal_run(nominal)[sensor] if not fitted]
    still, moving, theirs = judged("none.toml", sensor), judged(f"{GIVEN_LAG_S}.toml", sensor), bins(theirs)
    drawing.keys(
        [
            ("other-line wide", f"PX4's method: {rms(theirs)} mm/s² rms"),
            ("own-line wide dashed", f"Isotherm, without a lag: {rms(still)} mm/s² rms"),
            ("own-line wide", f"Isotherm, with a lag of {GIVEN_LAG_S} s, given: {rms(moving)} mm/s² rms"),
        ]
    )
    plot = Plot(drawing, (32, 75), span([still, moving, theirs]), 150, "temperature [°C]", "deviation [mm/s²]")
    plot.line(theirs, "other-line wide")
    plot.line(still, "own-line wide dashed")
    plot.line(moving, "own-line wide")
    return drawing.svg()


# Drawings.


@picture("system")
def _() -> str:
    drawing = Drawing("Recordings are calibrated into a coefficient table, which the service applies to the samples of an acquisition")
    width, height, left, right = 188, 52, 10, 302

    def box(x: float, y: float, name: str, what: str, colour: str = "rim") -> None:
        drawing.box(x, y, width, height, f"fill {colour}-line thick")
        drawing.text(x + width / 2, y + 22, name, "bold", "middle")
        drawing.text(x + width / 2, y + 41, what, "soft small", "middle")

    def down(x: float, y: float, words: str) -> None:
        drawing.arrow([(x + width / 2, y + height), (x + width / 2, y + 96)], "ink", "thick")
        drawing.text(x + width / 2 + 10, y + height + 28, words, "small")

    drawing.text(left + width / 2, 28, "offline", "soft", "middle")
    drawing.text(right + width / 2, 28, "live", "soft", "middle")
    rows = [44, 140, 236, 332]
    for y, (name, what, after) in zip(
        rows,
        [
            ("recordings", "logs, campaigns, CSV", ""),
            ("isotherm calibrate", "fits every curve", ""),
            ("coefficient table", "sealed, with its origin", "and another recording"),
            ("isotherm verify", "errors with intervals", None),
        ],
        strict=True,
    ):
        box(left, y, name, what, "own" if name.startswith("isotherm") else "rim")
        if after is not None:
            down(left, y, after)
    for y, (name, what, after) in zip(
        rows[:1] + rows[2:],
        [
            ("acquisition", "serial line, IIO, ROS 2", "raw samples"),
            ("isothermd", "corrects every sample", "increments"),
            ("navigation", "filters, loggers, ROS 2", None),
        ],
        strict=True,
    ):
        box(right, y, name, what, "own" if name == "isothermd" else "rim")
        if after == "raw samples":
            drawing.arrow([(right + width / 2, y + height), (right + width / 2, rows[2])], "ink", "thick")
            drawing.text(right + width / 2 + 10, 152, "raw samples:", "small")
            drawing.text(right + width / 2 + 10, 170, "pulses,", "small")
            drawing.text(right + width / 2 + 10, 188, "temperature", "small")
        elif after:
            down(right, y, "m/s, rad")
    middle = rows[2] + height / 2
    drawing.arrow([(left + width, middle), (right, middle)], "own", "thick")
    drawing.text((left + width + right) / 2, middle - 10, "replaced", "small", "middle")
    drawing.text((left + width + right) / 2, middle + 22, "in flight", "small", "middle")
    drawing.y = rows[3] + height + 2
    return drawing.svg()


# Plots of reports.


def report(kind: str) -> str:
    isotherm("calibrate", "turntable", f"{ROOT}/examples/campaign/campaign.toml", "-o", "imu.toml", "--report", "calibrate.html")
    if kind == "verify":
        isotherm("simulate", "run", "-o", "run", "--interval", "1")
        isotherm("verify", "--table", "imu.toml", "run/run.csv", "--report", "verify.html")
    return (scratch() / f"{kind}.html").read_text()


def plot_of(page: str, start: str) -> str:
    """The plot of a report whose label starts so, as a file that stands alone."""
    style = re.search(r"<style>(.*?)</style>", page, re.S)
    svg = re.search(rf'<svg[^>]*aria-label="{re.escape(start)}.*?</svg>', page, re.S)
    assert style and svg, start
    box = re.search(r'viewBox="0 0 (\S+) (\S+)"', svg[0])
    assert box
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{box[1]}" height="{box[2]}"'
    own = "text { font-family: sans-serif } .page { fill: #ffffff }"
    own += " @media (prefers-color-scheme: dark) { .page { fill: #0d1117 } }"
    back = '<rect class="page" width="100%" height="100%"/>'
    return (head + svg[0].removeprefix("<svg")).replace(">", f"><style>{style[1]} {own}</style>{back}", 1) + "\n"


picture("bias")(lambda: plot_of(report("calibrate"), "Bias of A1: Bias"))
picture("residuals")(lambda: plot_of(report("calibrate"), "Bias of A1: set point less table"))
picture("stability")(lambda: plot_of(report("verify"), "A1 over temperature"))
picture("after")(lambda: plot_of(report("verify"), "A1 after, over time"))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--check", action="store_true", help="compare, and write nothing")
    arguments.add_argument("name", nargs="*", choices=[[], *PICTURES], help="picture, without .svg")
    options = arguments.parse_args()
    wrong = []
    for name in options.name or PICTURES:
        made, file = PICTURES[name](), FOLDER / f"{name}.svg"
        if not options.check:
            file.write_text(made)
        elif not file.exists() or file.read_text() != made:
            wrong.append(name)
    if options.check and not options.name:
        wrong += sorted(file.stem for file in FOLDER.glob("*.svg") if file.stem not in PICTURES)
    if wrong:
        sys.exit(f"not as docs/pictures.py makes them: {', '.join(wrong)}; renew them with python3 docs/pictures.py")


main()
