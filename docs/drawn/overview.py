"""The system, and the states of a campaign."""

from .chart import Drawing
from .command import picture


@picture("system")
def _() -> str:
    drawing = Drawing(
        "Recordings are calibrated into a coefficient table, which the service applies to the samples of an acquisition"
    )
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


@picture("campaign-states")
def _() -> str:
    drawing = Drawing(
        "The states of an automatic campaign: approach, soak, travel, settle, dwell, turns, ramps and runs, safe state"
    )
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
    middle = [12 + step * k + high / 2 for k in range(len(states))]
    drawing.arrow(
        [(right, middle[4]), (right + 20, middle[4]), (right + 20, middle[2]), (right, middle[2])], "ink", "thick"
    )
    drawing.text(right + 26, middle[3], "next", "small")
    drawing.text(right + 26, middle[3] + 18, "position", "small")
    drawing.arrow(
        [(right, middle[5]), (right + 94, middle[5]), (right + 94, middle[0]), (right, middle[0])], "ink", "thick"
    )
    drawing.text(right + 26, middle[1] - 18, "next", "small")
    drawing.text(right + 26, middle[1], "set point", "small")
    # What disturbs.
    for row, name, what, lines in (
        (
            2,
            "paused",
            "commands nothing",
            ("An instrument does not", "answer, or the IMU is silent.", "It continues by itself."),
        ),
        (
            5,
            "ended",
            "in the safe state",
            ("Alarm, limit, operator, signal,", "or patience is over. The same", "command continues."),
        ),
    ):
        box(beside, middle[row] - 20, name, what, "raw")
        for k, line in enumerate(lines):
            drawing.text(beside, middle[row] + 42 + 18 * k, line, "small")
    drawing.y = middle[-1] + high / 2
    return drawing.svg()
