#!/usr/bin/env python3
"""Takes the pictures of docs/calibrate.md and docs/verify.md out of reports, as SVG files that stand alone.

    isotherm calibrate turntable examples/campaign/campaign.toml -o imu.toml --report imu.html
    isotherm simulate run -o run && isotherm verify --table imu.toml run/run.csv --report verify.html
    python3 docs/pictures.py imu.html verify.html docs/pictures
"""

import pathlib
import re
import sys

# Report, label of the plot in it, name of the picture.
PICTURES = [
    (0, "Bias of A1: Bias", "bias"),
    (0, "Bias of A1: set point less table", "residuals"),
    (1, "A1 over temperature", "stability"),
    (1, "A1 after, over time", "after"),
]


def main() -> None:
    reports = [pathlib.Path(name).read_text() for name in sys.argv[1:3]]
    folder = pathlib.Path(sys.argv[3])
    folder.mkdir(exist_ok=True)
    for report, label, name in PICTURES:
        style = re.search(r"<style>(.*?)</style>", reports[report], re.S).group(1)
        svg = re.search(rf'<svg[^>]*aria-label="{re.escape(label)}.*?</svg>', reports[report], re.S).group(0)
        width, height = re.search(r'viewBox="0 0 (\S+) (\S+)"', svg).groups()
        head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        # A picture in a page has a light background whatever the page's is.
        light = re.sub(r"@media screen and \(prefers-color-scheme: dark\) \{\s*:root \{.*?\}\s*\}", "", style, flags=re.S)
        back = '<rect width="100%" height="100%" fill="#ffffff"/>'
        svg = head + svg.removeprefix("<svg")
        svg = svg.replace(">", f"><style>{light} text {{ font-family: sans-serif }}</style>{back}", 1)
        (folder / f"{name}.svg").write_text(svg + "\n")


main()
