"""From a campaign to a table and back to a run, with pandas: calibrate, look, verify, replay."""

import argparse
import tomllib
from pathlib import Path

import isotherm
import pandas as pd


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("campaign", type=Path, help="for example examples/campaign/campaign.toml")
    arguments.add_argument("output", type=Path, help="folder for what comes out")
    options = arguments.parse_args()
    options.output.mkdir(exist_ok=True)

    # Settings and samples can come from any source. Here they come from the campaign's files, and one dwell is
    # excluded.
    settings = tomllib.loads(options.campaign.read_text())
    samples = pd.read_csv(options.campaign.with_name(settings["samples"]))
    print(samples.groupby("set_point_c")["a1_head"].agg(["mean", "std"]).head(3))
    calibration = isotherm.calibrate_turntable(settings, samples, exclude=[(-25.0, 3)])
    for severity, row, message in calibration.findings:
        print(severity, row, message)
    print(calibration.accuracy)
    bias = calibration.orders["A1"]["bias"]
    print(pd.DataFrame(bias["orders"])[["order", "residual_sd", "r_squared", "f", "f_p"]])
    print("chosen:", bias["selected"], bias["reason"])
    residuals = pd.DataFrame(calibration.residuals * 1e6, columns=["A1", "A2", "A3"])
    residuals["set_point_c"] = [dwell[0] for dwell in calibration.dwells]
    print(residuals.groupby("set_point_c").std().round(3))  # 1e-6 g0
    calibration.save(options.output / "table.toml", report=options.output / "calibration.html")

    # Compensate the same samples with the new table.
    table = isotherm.Table.load(options.output / "table.toml")
    increments = isotherm.replay(table, samples)
    samples["a1_g0"] = increments["a1_dv"] / (samples["interval_ns"] * 1e-9 * table.gravity)
    print(samples.groupby("position")["a1_g0"].mean().round(5))
    print(table)


if __name__ == "__main__":
    main()
