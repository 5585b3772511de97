"""Latency, as the benches measured it: the page of figures is the source."""

import re

from .chart import WIDTH, Drawing
from .command import ROOT, picture


@picture("latency")
def _() -> str:
    section = (ROOT / "docs/figures.md").read_text().split("\n## Latency\n")[1].split("\n## ")[0]
    table = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if line.startswith("|")
    ]
    # Rows: compared with what. Columns: 400 Hz p50, p90, 2 kHz p50, p90, each a ratio with its interval.
    titles, rows = table[0][1:], [row for row in table[1:] if re.search(r"\d", row[1])]
    drawing = Drawing("Round trip of a whole IMU divided by that of bare iceoryx2")
    drawing.heading(
        "Round trip through the service, over bare iceoryx2",
        "Below 1 the service is faster: it rehearses its path before each",
        "sample. Medians of five runs, with their range, from docs/figures.md.",
    )
    rate = ""
    left, right, high = 128, WIDTH - 58, 1.5
    for row, colour in zip(rows, ("own", "third", "other"), strict=True):
        drawing.heading(row[0].replace("`", ""))
        top = drawing.y
        for title, cell in zip(titles, row[1:], strict=True):
            rate = title.rsplit(" ", 1)[0] if " " in title else rate
            value, low, upper = (float(number) for number in re.findall(r"\d+\.\d+", cell))
            y = drawing.y + 4

            def place(ratio: float) -> float:
                return left + ratio / high * (right - left)

            drawing.text(left - 8, y + 15, f"{rate}, {title.split(' ')[-1]}", "small", "end")
            drawing.box(left, y, place(value) - left, 20, colour, 2)
            drawing.line([(place(low), y + 10), (place(min(upper, high)), y + 10)], "ink-line thick")
            drawing.text(WIDTH - 12, y + 15, f"{value:.2f}", "bold small", "end")
            drawing.y += 28
        drawing.line([(left, top), (left, drawing.y)], "rim-line")
        drawing.line(
            [(left + (right - left) / high, top), (left + (right - left) / high, drawing.y)], "ink-line dashed"
        )
        drawing.text(left + (right - left) / high, drawing.y + 16, "1: equal", "soft small", "middle")
        drawing.y += 20
    return drawing.svg()
