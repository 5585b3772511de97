"""The real thermal run of a consumer IMU."""

import csv
import functools
import json
from collections.abc import Callable

from .chart import Drawing, Plot, Points, span
from .command import ROOT, isotherm, picture, scratch

CONSUMER = ROOT / "calibration/fit/tests/data/consumer"
# A cooling and a heating end here, and the cooling that is judged begins [s].
FITTED_S = 3129.6
# A3 and G2 by their names in a vehicle, with the factor from m/s or rad and the unit.
SENSORS = {"a3_dv": ("accelerometer Z", "mm/s²"), "g2_da": ("gyroscope Y", "mrad/s")}
GIVEN_LAG_S = "100"


def warm_up_table(lag: str) -> dict:
    """Writes LAG.toml from the cooling and the heating, and returns the command's result."""
    words = [
        "calibrate",
        "warm-up",
        f"{CONSUMER}/thermal-run.csv",
        "--nominal",
        f"{CONSUMER}/nominal.toml",
        "--imu",
        "consumer",
    ]
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
    drawing.keys(
        [("raw-line wide", "raw"), ("own-line wide", f"compensated by Isotherm, with a lag of {GIVEN_LAG_S} s")]
    )
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
    drawing.keys(
        [
            ("raw-line wide faint", "raw"),
            ("other-line wide", "PX4's method: a cubic"),
            ("own-line wide dashed", "Isotherm, without a lag"),
        ]
    )
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
    theirs_rows = [(t, reading - curve(t)) for t, reading, fitted in thermal_run(nominal)[sensor] if not fitted]
    still, moving, theirs = judged("none.toml", sensor), judged(f"{GIVEN_LAG_S}.toml", sensor), bins(theirs_rows)
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
