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
import tomllib
from collections.abc import Callable
from math import cos, radians, sin
from pathlib import Path

from chart import WIDTH, Drawing, Plot, Points, span

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


# In three dimensions.

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
AXES = ("raw", "other", "own")
IDENTITY: Matrix = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def times(m: Matrix, v: Vector) -> Vector:
    return tuple(sum(a * b for a, b in zip(row, v, strict=True)) for row in m)  # type: ignore[return-value]


def product(a: Matrix, b: Matrix) -> Matrix:
    return tuple(times(tuple(zip(*b, strict=True)), row) for row in a)  # type: ignore[arg-type, return-value]


def turned(outer_deg: float, inner_deg: float) -> Matrix:
    """From the axes of the IMU to those of the laboratory: Rx(outer) Rz(inner), X along the outer axis, Z up."""
    (a, b), (c, d) = [(cos(radians(angle)), sin(radians(angle))) for angle in (outer_deg, inner_deg)]
    return product(((1, 0, 0), (0, a, -b), (0, b, a)), ((c, -d, 0), (d, c, 0), (0, 0, 1)))


def upright(direction: Vector) -> Matrix:
    """The shortest rotation that brings a direction of the IMU upwards."""
    length = sum(x * x for x in direction) ** 0.5
    x, y, z = (value / length for value in direction)
    if z < -0.999:
        return ((1, 0, 0), (0, -1, 0), (0, 0, -1))
    k = 1 / (1 + z)
    return ((1 - x * x * k, -x * y * k, -x), (-x * y * k, 1 - y * y * k, -y), (x, y, z))


class Scene:
    """A view from the front, from above and a little from the right."""

    SIZE = (0.8, 0.6, 0.35)

    def __init__(self, drawing: Drawing, x: float, y: float, scale: float):
        self.drawing, self.x, self.y, self.scale = drawing, x, y, scale

    def at(self, v: Vector) -> tuple[float, float]:
        x, y, z = v
        return self.x + self.scale * (0.95 * x + 0.42 * y), self.y + self.scale * (0.14 * x - 0.34 * y - 0.95 * z)

    @staticmethod
    def depth(v: Vector) -> float:
        return -0.37 * v[0] + 0.85 * v[1] - 0.36 * v[2]

    def arc(self, centre: Vector, radius: float, about: int, first_deg: float, last_deg: float) -> list[tuple[float, float]]:
        """A part of a circle about the axis X (0) or Z (2), right-handed."""
        points = []
        for k in range(25):
            angle = radians(first_deg + (last_deg - first_deg) * k / 24)
            a, b = radius * cos(angle), radius * sin(angle)
            x, y, z = centre
            points.append(self.at((x, y + a, z + b) if about == 0 else (x + a, y + b, z)))
        return points

    def imu(self, m: Matrix, names: bool = True, centre: Vector = (0, 0, 0)) -> None:
        """A box with the three input axes."""

        def moved(v: Vector) -> Vector:
            return tuple(a + b for a, b in zip(times(m, v), centre, strict=True))  # type: ignore[return-value]

        def along(number: int, far: float) -> tuple[float, float]:
            return self.at(moved(tuple((self.SIZE[number] + far) * (k == number) for k in range(3))))  # type: ignore[arg-type]

        def axis(number: int) -> None:
            self.drawing.arrow([along(number, 0), along(number, 0.9)], AXES[number], "thick")

        columns = list(zip(*m, strict=True))
        behind = [number for number in range(3) if self.depth(columns[number]) > 0]
        for number in behind:
            axis(number)
        a, b, c = self.SIZE
        for number, sign in ((number, sign) for number in range(3) for sign in (1, -1)):
            if sign * self.depth(columns[number]) >= 0:
                continue
            p, q = [(1, 2), (2, 0), (0, 1)][number]
            corners = []
            for u, v in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
                corner = [0.0, 0.0, 0.0]
                corner[number], corner[p], corner[q] = sign * (a, b, c)[number], u * (a, b, c)[p], v * (a, b, c)[q]
                corners.append(self.at(moved(tuple(corner))))
            self.drawing.area(corners, "fill")
            self.drawing.line([*corners, corners[0]], "rim-line")
        for number in range(3):
            if number not in behind:
                axis(number)
        for number in range(3 if names else 0):
            x, y = along(number, 1.25)
            self.drawing.text(x, y + 5, f"A{number + 1}", f"small bold {AXES[number]}", "middle")


@picture("turntable")
def _() -> str:
    drawing = Drawing("A two-axis turntable: the outer axis is horizontal, the inner axis turns with it, both are right-handed")
    scene = Scene(drawing, 225, 205, 62)
    for side in (-1, 1):
        # A pedestal, and the bearing of the outer axis on it.
        feet = [(side * 2.35, 0.3, -1.9), (side * 2.35, -0.3, -1.9), (side * 2.35, -0.3, 0.25), (side * 2.35, 0.3, 0.25)]
        drawing.area([scene.at(v) for v in feet], "fill")
        drawing.line([scene.at(v) for v in [*feet, feet[0]]], "rim-line thick")
    drawing.line([scene.at((x, 0, -1.9)) for x in (-2.9, 2.9)], "rim-line wide")
    cradle = ((-2.35, 0), (-1.75, 0), (-1.75, -0.85), (1.75, -0.85), (1.75, 0), (2.35, 0))
    drawing.line([scene.at((x, 0, z)) for x, z in cradle], "soft-line wide")
    drawing.line([scene.at((0, 0, z)) for z in (-1.35, -0.5)], "third-line wide")
    plate = scene.arc((0, 0, -0.5), 1.3, 2, 0, 360)
    drawing.area(plate, "fill")
    drawing.line(plate, "rim-line thick")
    drawing.arrow(scene.arc((0, 0, -0.5), 1.3, 2, -150, -40), "third", "wide", 11)
    scene.imu(IDENTITY, centre=(0, 0, -0.12))
    drawing.arrow([scene.at((2.35, 0, 0)), scene.at((3.5, 0, 0))], "third", "wide", 11)
    drawing.arrow(scene.arc((2.8, 0, 0), 0.5, 0, -60, 200), "third", "thick", 9)
    x, y = scene.at((2.5, 0, 1.15))
    drawing.text(x, y, "outer axis, X", "bold third", "middle")
    x, y = scene.at((0, 0, -1.65))
    drawing.text(x - 62, y, "inner axis, Z at outer 0", "bold third")
    up = scene.at((-2.6, 0, 1.3)), scene.at((-2.6, 0, 2.3))
    drawing.arrow(list(up), "ink", "wide", 10)
    drawing.text(up[1][0] + 14, up[1][1] + 12, "up: the specific force at rest", "small")
    drawing.y = 358
    for line in ("Positive angles are right-handed about their axes. At outer 0", "and inner 0 this mounting has A1 along the outer axis, A3 up."):
        drawing.y += 19
        drawing.text(12, drawing.y, line, "small")
    return drawing.svg()


@picture("positions")
def _() -> str:
    campaign = tomllib.loads((ROOT / "examples/campaign/campaign.toml").read_text())
    drawing = Drawing("The twelve positions of the example campaign: each axis up and down, at two headings")
    drawing.heading("Twelve positions: six faces, two headings", "With the angles of the outer and the inner axis.", "Each accelerometer points up twice and down twice.")
    top = drawing.y
    for k, position in enumerate(campaign["position"]):
        x, y = 64 + 124 * (k % 4), top + 74 + 172 * (k // 4)
        m = turned(position["outer_deg"], position["inner_deg"])
        # The file states the direction that the angles give.
        assert all(abs(a - b) < 1e-9 for a, b in zip(m[2], position["specific_force"], strict=True)), position
        Scene(drawing, x, y, 27).imu(m)
        sign, axis = position["up"]
        drawing.text(x, y + 78, f"{position['number']}: A{'xyz'.index(axis) + 1} {'up' if sign == '+' else 'down'}", "bold small", "middle")
        drawing.text(x, y + 95, f"{position['outer_deg']}°, {position['inner_deg']}°", "soft small", "middle")
    drawing.y = top + 3 * 172 + 6
    return drawing.svg()


@picture("tumble")
def _() -> str:
    drawing = Drawing("The poses of a tumble: six faces, eight corners, twelve edges")
    signs = [(a, b, c) for a in (1, 0, -1) for b in (1, 0, -1) for c in (1, 0, -1)]
    for count, what in ((1, "6 faces"), (3, "8 corners, each against two books"), (2, "12 edges")):
        drawing.heading(what)
        poses = [v for v in signs if sum(map(abs, v)) == count]
        poses.sort(key=lambda v: (-sum(v), [-x for x in v]))
        top = drawing.y
        for k, pose in enumerate(poses):
            x, y = 46 + 82 * (k % 6), top + 40 + 92 * (k // 6)
            Scene(drawing, x, y, 21).imu(upright(pose), names=False)
            up = " ".join(f"{'+' if sign > 0 else '−'}{number + 1}" for number, sign in enumerate(pose) if sign)
            drawing.text(x, y + 47, up, "soft small", "middle")
        drawing.y = top + 92 * ((len(poses) + 5) // 6) + 2
    drawing.y += 4
    x = 12
    for number, colour in enumerate(AXES):
        drawing.arrow([(x, drawing.y + 8), (x + 24, drawing.y + 8)], colour, "thick")
        drawing.text(x + 30, drawing.y + 13, f"A{number + 1}", f"bold {colour}")
        x += 70
    drawing.text(x, drawing.y + 13, "+1: A1 points up; −2: A2 points down", "small")
    drawing.y += 14
    return drawing.svg()


@picture("campaign-states")
def _() -> str:
    drawing = Drawing("The states of an automatic campaign: approach, soak, travel, settle, dwell, turns, ramps and runs, safe state")
    high, left, width, step, beside = 40, 12, 160, 66, 292

    def box(x: float, y: float, name: str, what: str, colour: str = "rim") -> None:
        drawing.box(x, y, width, high, f"fill {colour}-line thick")
        drawing.text(x + width / 2, y + 17, name, "bold small", "middle")
        drawing.text(x + width / 2, y + 33, what, "soft small", "middle")

    states = [
        ("approach", "chamber ramps", "rim"),
        ("soak", "time, rates of change", "rim"),
        ("travel", "turntable moves", "rim"),
        ("settle", "turntable at rest", "rim"),
        ("dwell", "samples are taken", "own"),
        ("turns", "if in the plan", "own"),
        ("ramps, then runs", "each after a soak", "own"),
        ("safe state", "is read back", "other"),
    ]
    for k, (name, what, colour) in enumerate(states):
        y = 12 + step * k
        box(left, y, name, what, colour)
        if k + 1 < len(states):
            drawing.arrow([(left + width / 2, y + high), (left + width / 2, y + step)], "ink", "thick")
    # The next position and the next set point.
    right = left + width
    y = [12 + step * k + high / 2 for k in range(len(states))]
    drawing.arrow([(right, y[4]), (right + 20, y[4]), (right + 20, y[2]), (right, y[2])], "ink", "thick")
    drawing.text(right + 26, y[3], "next", "small")
    drawing.text(right + 26, y[3] + 18, "position", "small")
    drawing.arrow([(right, y[5]), (right + 94, y[5]), (right + 94, y[0]), (right, y[0])], "ink", "thick")
    drawing.text(right + 26, y[1] - 18, "next", "small")
    drawing.text(right + 26, y[1], "set point", "small")
    # What disturbs.
    for row, name, what, lines in (
        (2, "paused", "commands nothing", ("An instrument does not", "answer, or the IMU is silent.", "It continues by itself.")),
        (5, "ended", "in the safe state", ("Alarm, limit, operator, signal,", "or patience is over. The same", "command continues.")),
    ):
        box(beside, y[row] - 20, name, what, "raw")
        for k, line in enumerate(lines):
            drawing.text(beside, y[row] + 42 + 18 * k, line, "small")
    drawing.y = y[-1] + high / 2
    return drawing.svg()


# Simulated data.


def sweeps(folder: str, ramp: int) -> list[Points]:
    """The error of A1 under the table without transients [1e-6 g0], heating and cooling, by bins of temperature."""
    isotherm("replay", "--table", f"{folder}/table.toml", f"{folder}/ramp-{ramp}.csv", "-o", f"{folder}/{ramp}.csv")
    with open(scratch() / folder / f"{ramp}.csv") as increments, open(scratch() / folder / f"ramp-{ramp}.csv") as raw:
        rows = [
            (float(sample["a1_head"]), float(increment["a1_dv"]) / int(sample["interval_ns"]) * 1e15 / 9.8015)
            for increment, sample in zip(csv.DictReader(increments), csv.DictReader(raw), strict=True)
        ]
    temperatures = [t for t, _ in rows]
    low, high = min(temperatures), max(temperatures)
    # The holds at both ends are left out.
    warm = next(k for k, t in enumerate(temperatures) if t > high - 0.02)
    cool = max(k for k, t in enumerate(temperatures) if t > high - 0.02)
    found = []
    for part in (rows[:warm], rows[cool:]):
        of: dict[int, list[float]] = {}
        for t, error in part:
            if low + 0.02 < t < high - 0.02:
                of.setdefault(int(t / 0.05), []).append(error)
        found.append([((k + 0.5) * 0.05, sum(errors) / len(errors)) for k, errors in sorted(of.items())])
    return found


@picture("lag-hysteresis")
def _() -> str:
    drawing = Drawing("The error of a bias curve under a lag, which grows with the rate, and under hysteresis, which does not")
    drawing.heading(
        "What a bias curve over temperature leaves",
        "Simulated ramps up and down at two rates, accelerometer A1.",
    )
    drawing.keys([("own-line thick", "20 °C/h, heating and cooling"), ("raw-line thick", "70 °C/h, heating and cooling")])
    cases = {
        "lag": ("A lag of 240 s: the loop opens with the rate", ["--lag", "240", "--transient", "350,-200,120"]),
        "play": ("Hysteresis: the loop is the same at both rates", ["--play", "0.2", "--hysteresis", "-300,200,100"]),
    }
    for folder, (words, options) in cases.items():
        isotherm("simulate", "ramp", "-o", folder, "--seed", "1", *options)
        of = [sweeps(folder, ramp) for ramp in (1, 2)]
        drawing.heading(words)
        plot = Plot(drawing, (1, 4.1), (-100, 100), 150, "head temperature [V]", "error [µg]")
        for colour, loop in zip(("own", "raw"), of, strict=True):
            for sweep in loop:
                plot.line(sweep, f"{colour}-line thick")
    return drawing.svg()


@picture("allan")
def _() -> str:
    isotherm("simulate", "run", "-o", "night", "--temperatures", "20,21", "--ramp", "1", "--hold", "1", "--sensor-noise", "40", "--seed", "3")
    sensor = json.loads(isotherm("noise", "--table", "night/truth.toml", "night/run.csv", "--json"))["sensors"][0]
    of = {coefficient["letter"]: coefficient for coefficient in sensor["model"]["coefficients"]}
    taus, deviations = sensor["tau_s"], sensor["adev_in_unit"]
    q, n = of["Q"]["value_in_unit"], of["N"]["value_in_unit"]
    limits = {letter: of[letter]["below_in_unit"] for letter in "BK"}
    assert all(limits.values()), limits
    drawing = Drawing("Allan deviation of a simulated accelerometer with its coefficients")
    drawing.heading("Allan deviation of an accelerometer", "Simulated: one hour, white noise of 40 µg/√Hz.")
    micro = 1e6
    drawing.keys(
        [
            ("own-line wide", "Allan deviation, with 95 % intervals"),
            ("raw-line thick dashed", f"Q, quantisation noise: {q * micro:.2f} µg s"),
            ("other-line thick dashed", f"N, velocity random walk: {n * micro:.1f} µg/√Hz"),
        ]
    )
    for letter, name, unit in (("B", "bias instability", "µg"), ("K", "acceleration random walk", "µg/(s√Hz)")):
        drawing.y += 18
        drawing.text(48, drawing.y - 6, f"{letter}, {name}: below {limits[letter] * micro:.2f} {unit}", "soft")
    plot = Plot(drawing, (0.08, 1500), (0.3, 400), 230, "tau [s]", "deviation [µg]", logarithmic=True)
    plot.bars([(t, max(a * micro, 0.31), b * micro) for t, (a, b) in zip(taus, sensor["interval_in_unit"], strict=True)], "own-line faint")
    plot.line([(t, 3**0.5 * q / t * micro) for t in (0.08, 15)], "raw-line thick dashed")
    plot.line([(t, n / t**0.5 * micro) for t in (0.08, 1500)], "other-line thick dashed")
    plot.line([(t, d * micro) for t, d in zip(taus, deviations, strict=True)], "own-line wide")
    return drawing.svg()


# A change of the rows or of the campaign file of a simulated campaign, and a calibration in spite of it.


def simulated(folder: str, *options: str) -> Path:
    isotherm("simulate", "campaign", "-o", folder, *options)
    return scratch() / folder


def with_rows(folder: str, change: Callable[[dict[str, str]], None]) -> None:
    file = simulated(folder) / "samples.csv"
    rows = list(csv.DictReader(file.read_text().splitlines()))
    for row in rows:
        change(row)
    with open(file, "w") as out:
        writer = csv.DictWriter(out, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def residual(folder: str, plot: str, *options: str) -> str:
    """A plot of the report on this campaign, after the finding of its name was printed."""
    words = ["calibrate", "turntable", f"{folder}/campaign.toml", "-o", f"{folder}/imu.toml", "--report", f"{folder}.html", "--json"]
    found = json.loads(isotherm(*words, *options))
    assert any(finding["name"] == folder for finding in found["findings"]), folder
    return plot_of((scratch() / f"{folder}.html").read_text(), plot)


@picture("lack-of-fit")
def _() -> str:
    simulated("lack-of-fit")
    return residual("lack-of-fit", "Bias of A1: set point less table", "--order", "1")


@picture("soak")
def _() -> str:
    simulated("soak", "--lag", "1800", "--transient", "350,-200,120", "--soak", "1500")
    return residual("soak", "Bias of A1: set point less table")


@picture("outlier")
def _() -> str:
    def knocked(row: dict[str, str]) -> None:
        if (row["set_point_c"], row["position"]) == ("10", "6"):
            row["a1_positive"] = str(int(row["a1_positive"]) * 10002 // 10000)

    with_rows("outlier", knocked)
    return residual("outlier", "A1: residuals over time")


@picture("position-off")
def _() -> str:
    file = simulated("position-off") / "campaign.toml"
    # Position 9 is off by two milliradians.
    before, after = re.split(r"(?<=number = 9\n)", file.read_text())
    file.write_text(before + after.replace("[0, 1, 0]", "[0.0, 0.99999775, 0.0021213]", 1))
    return residual("position-off", "A3: residuals over time", "--accept", "position-off")


@picture("device-changed")
def _() -> str:
    second = csv.DictReader((simulated("second", "--vary", "--seed", "5") / "samples.csv").read_text().splitlines())
    of = {(row["set_point_c"], row["position"], row["sequence"]): row for row in second}

    def changed(row: dict[str, str]) -> None:
        if float(row["set_point_c"]) >= 10:
            other = of[row["set_point_c"], row["position"], row["sequence"]]
            row.update({name: value for name, value in other.items() if re.match("a[123]_", name)})

    with_rows("device-changed", changed)
    return residual("device-changed", "Bias of A3: set point less table", "--accept", "device-changed,lack-of-fit,level")


# Measured by the benches: the page of figures is the source.


@picture("latency")
def _() -> str:
    section = (ROOT / "docs/figures.md").read_text().split("\n## Latency\n")[1].split("\n## ")[0]
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if line.startswith("|")]
    # Rows: compared with what. Columns: 400 Hz p50, p90, 2 kHz p50, p90, each a ratio with its interval.
    titles, rows = table[0][1:], [row for row in table[1:] if re.search(r"\d", row[1])]
    drawing = Drawing("Round trip of a whole IMU divided by that of bare iceoryx2")
    drawing.heading(
        "Round trip through the service, over bare iceoryx2",
        "Below 1 the service is faster, since it rehearses its path shortly before",
        "each sample. Ratios of one run with 95 % intervals: docs/figures.md.",
    )
    names = {"plain": "bare iceoryx2, plain", "rehearsed too": "bare iceoryx2, rehearsed too"}
    rate = ""
    left, right, high = 128, WIDTH - 58, 1.5
    for row, colour in zip(rows, ("own", "third"), strict=True):
        drawing.heading(f"compared with {names.get(row[0], row[0])}")
        top = drawing.y
        for title, cell in zip(titles, row[1:], strict=True):
            rate = title.rsplit(" ", 1)[0] if " " in title else rate
            value, low, upper = (float(number) for number in re.findall(r"\d+\.\d+", cell))
            y = drawing.y + 4

            def place(ratio: float) -> float:
                return left + ratio / high * (right - left)

            drawing.text(left - 8, y + 15, f"{rate}, {title.split(' ')[-1]}", "small", "end")
            drawing.box(left, y, place(value) - left, 20, colour, 2)
            drawing.line([(place(low), y + 10), (place(upper), y + 10)], "ink-line thick")
            drawing.text(WIDTH - 12, y + 15, f"{value:.2f}", "bold small", "end")
            drawing.y += 28
        drawing.line([(left, top), (left, drawing.y)], "rim-line")
        drawing.line([(left + (right - left) / high, top), (left + (right - left) / high, drawing.y)], "ink-line dashed")
        drawing.text(left + (right - left) / high, drawing.y + 16, "1: equal", "soft small", "middle")
        drawing.y += 20
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
