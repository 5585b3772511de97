"""What simulated data show: lag and hysteresis, and an Allan deviation."""

import csv
import json
from collections.abc import Sequence

from .chart import Drawing, Plot, Points
from .command import isotherm, picture, scratch


def sweeps(folder: str, ramp: int) -> Sequence[Points]:
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
    drawing = Drawing(
        "The error of a bias curve under a lag, which grows with the rate, and under hysteresis, which does not"
    )
    drawing.heading(
        "What a bias curve over temperature leaves",
        "Simulated ramps up and down at two rates, accelerometer A1.",
    )
    drawing.keys(
        [("own-line thick", "20 °C/h, heating and cooling"), ("raw-line thick dashed", "70 °C/h, heating and cooling")]
    )
    cases = {
        "lag": ("A lag of 240 s: the loop opens with the rate", ["--lag", "240", "--transient", "350,-200,120"]),
        "play": ("Hysteresis: the loop is the same at both rates", ["--play", "0.2", "--hysteresis", "-300,200,100"]),
    }
    for folder, (words, options) in cases.items():
        isotherm("simulate", "ramp", "-o", folder, "--seed", "1", *options)
        of = [sweeps(folder, ramp) for ramp in (1, 2)]
        drawing.heading(words)
        plot = Plot(drawing, (1, 4.1), (-100, 100), 150, "head temperature [V]", "error [µg]")
        for kind, loop in zip(("own-line thick", "raw-line thick dashed"), of, strict=True):
            for sweep in loop:
                plot.line(sweep, kind)
    return drawing.svg()


@picture("allan")
def _() -> str:
    isotherm(
        "simulate",
        "run",
        "-o",
        "night",
        "--temperatures",
        "20,21",
        "--ramp",
        "1",
        "--hold",
        "1",
        "--sensor-noise",
        "40",
        "--seed",
        "3",
    )
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
    plot.bars(
        [(t, max(a * micro, 0.31), b * micro) for t, (a, b) in zip(taus, sensor["interval_in_unit"], strict=True)],
        "own-line faint",
    )
    plot.line([(t, 3**0.5 * q / t * micro) for t in (0.08, 15)], "raw-line thick dashed")
    plot.line([(t, n / t**0.5 * micro) for t in (0.08, 1500)], "other-line thick dashed")
    plot.line([(t, d * micro) for t, d in zip(taus, deviations, strict=True)], "own-line wide")
    return drawing.svg()
