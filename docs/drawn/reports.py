"""Plots out of reports: a sound campaign, and five that have a finding."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

from .command import ROOT, isotherm, picture, scratch


def report(kind: str) -> str:
    isotherm(
        "calibrate",
        "turntable",
        f"{ROOT}/examples/campaign/campaign.toml",
        "-o",
        "imu.toml",
        "--report",
        "calibrate.html",
    )
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
    words = [
        "calibrate",
        "turntable",
        f"{folder}/campaign.toml",
        "-o",
        f"{folder}/imu.toml",
        "--report",
        f"{folder}.html",
        "--json",
    ]
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
    return residual(
        "device-changed", "Bias of A3: set point less table", "--accept", "device-changed,lack-of-fit,level"
    )
