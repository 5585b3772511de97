"""Charts and drawings as SVG files that stand alone: light or dark as the screen is, and readable on a phone."""

from collections.abc import Iterable, Sequence
from html import escape
from math import floor, log10

Points = Sequence[tuple[float, float]]

# Width of every picture. A page shows it at up to 1.45 times this size, a phone at 0.7.
WIDTH = 500
LINE = 20

# Names of colours, light and dark. Ink is text, rim lines of drawings, grid lines of charts.
COLOURS = {
    "back": ("#ffffff", "#0d1117"),
    "ink": ("#1f2328", "#e6edf3"),
    "soft": ("#59636e", "#9ea7b3"),
    "rim": ("#818b98", "#656c76"),
    "grid": ("#d9dfe5", "#2f353d"),
    "fill": ("#f3f5f8", "#1b212a"),
    "raw": ("#c2410c", "#fb8f44"),
    "own": ("#0969da", "#58a6ff"),
    "other": ("#1a7f37", "#3fb950"),
    "third": ("#8250df", "#bc8cff"),
}


def style() -> str:
    """The colours as classes: `NAME` for text and areas, `NAME-line` for lines."""
    light = "".join(f"--{name}:{colour};" for name, (colour, _) in COLOURS.items())
    dark = "".join(f"--{name}:{colour};" for name, (_, colour) in COLOURS.items())
    classes = "".join(
        f".{name}{{fill:var(--{name})}}.{name}-line{{fill:none;stroke:var(--{name});stroke-width:1}}"
        for name in COLOURS
    )
    return (
        f":root{{{light}}}@media (prefers-color-scheme:dark){{:root{{{dark}}}}}"
        f"text{{font:15px system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;fill:var(--ink)}}{classes}"
        ".thick{stroke-width:2.2}.wide{stroke-width:3.5}.bold{font-weight:600}.small{font-size:13.5px}text.soft{fill:var(--soft)}"
        ".dashed{stroke-dasharray:7 7}.faint{opacity:.55}"
        "text.mono{font:11.7px ui-monospace,'DejaVu Sans Mono',Menlo,Consolas,monospace;white-space:pre}"
    )


def number(value: float) -> str:
    """A coordinate with one decimal at most."""
    # Without the sign of a zero.
    return f"{round(value, 1) + 0.0:.1f}".removesuffix(".0")


def path(points: Iterable[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{number(x)} {number(y)}" for x, y in points)


class Drawing:
    """Elements of a picture, from the top to the bottom."""

    def __init__(self, title: str, width: float = WIDTH):
        self.title, self.width = title, width
        self.parts: list[str] = []
        # The next free line.
        self.y = 8.0

    def text(self, x: float, y: float, words: str, kind: str = "", anchor: str = "start", turn: bool = False) -> None:
        turned = f' transform="rotate(-90 {number(x)} {number(y)})"' if turn else ""
        named = f' class="{kind}"' if kind else ""
        at = "" if anchor == "start" else f' text-anchor="{anchor}"'
        self.parts.append(
            f'<text x="{number(x)}" y="{number(y)}"{named}{at}{turned}>{escape(words, quote=False)}</text>'
        )

    def heading(self, words: str, *under: str) -> None:
        """A line in bold, and lines below it."""
        self.y += LINE
        self.text(12, self.y - 2, words, "bold")
        for line in under:
            self.y += LINE - 2
            self.text(12, self.y - 2, line, "soft small")
        self.y += 6

    def line(self, points: Iterable[tuple[float, float]], kind: str) -> None:
        self.parts.append(f'<path class="{kind}" d="{path(points)}"/>')

    def area(self, points: Iterable[tuple[float, float]], kind: str) -> None:
        self.parts.append(f'<path class="{kind}" d="{path(points)}Z"/>')

    def box(
        self, x: float, y: float, width: float, height: float, kind: str = "fill rim-line", round: float = 6
    ) -> None:
        """A box with a rim, if the kind names two classes."""
        area, _, rim = kind.partition(" ")
        size = f'x="{number(x)}" y="{number(y)}" width="{number(width)}" height="{number(height)}" rx="{number(round)}"'
        self.parts.append(f'<rect class="{area}" {size}/>')
        if rim:
            self.parts.append(f'<rect class="{rim}" {size}/>')

    def circle(self, x: float, y: float, radius: float, kind: str) -> None:
        self.parts.append(f'<circle class="{kind}" cx="{number(x)}" cy="{number(y)}" r="{number(radius)}"/>')

    def arrow(
        self, points: Sequence[tuple[float, float]], colour: str = "ink", kind: str = "", head: float = 7
    ) -> None:
        """A line with a head at its end."""
        (x0, y0), (x1, y1) = points[-2:]
        length = ((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5 or 1.0
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        neck = (x1 - ux * head, y1 - uy * head)
        self.line([*points[:-1], neck], f"{colour}-line {kind}".strip())
        half = head * 0.55
        self.area(
            [(x1, y1), (neck[0] - uy * half, neck[1] + ux * half), (neck[0] + uy * half, neck[1] - ux * half)], colour
        )

    def keys(self, entries: Sequence[tuple[str, str]]) -> None:
        """The legend: a class of lines and its words, one a line."""
        for kind, words in entries:
            self.y += LINE
            self.line([(14, self.y - 7), (40, self.y - 7)], kind)
            self.text(48, self.y - 2, words)
        self.y += 8

    def svg(self) -> str:
        height = number(self.y + 10)
        inside = "\n".join(self.parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {number(self.width)} {height}" '
            f'width="{number(self.width * 1.45)}" role="img">\n'
            f"<title>{escape(self.title)}</title>\n<style>{style()}</style>\n"
            f'<rect class="back" width="100%" height="100%" rx="8"/>\n{inside}\n</svg>\n'
        )


def ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Round numbers between two others."""
    step = 10.0 ** floor(log10((high - low) / about))
    step *= next(by for by in (1, 2, 5, 10) if (high - low) / (by * step) <= about + 0.5)
    first = floor(low / step + 0.999999)
    found: list[float] = []
    while (first + len(found)) * step <= high + step * 1e-6:
        found.append((first + len(found)) * step)
    return found


def label(value: float, step: float) -> str:
    digits = max(0, -floor(log10(step) + 1e-9))
    words = f"{value + 0.0:.{digits}f}"
    return words.replace("-", "−") if float(words) else f"{0:.{digits}f}"


class Plot:
    """Axes in a drawing, below what it has already."""

    LEFT, RIGHT = 66, 14

    def __init__(
        self,
        drawing: Drawing,
        x: tuple[float, float],
        y: tuple[float, float],
        height: float,
        along: str,
        up: str,
        logarithmic: bool = False,
        left: float = LEFT,
        right: float = RIGHT,
    ):
        self.drawing, self.x_range, self.y_range, self.logarithmic = drawing, x, y, logarithmic
        self.left, self.right = left, drawing.width - right
        self.top, self.bottom = drawing.y + 8, drawing.y + 8 + height
        across, upward = (self.decades(x), self.decades(y)) if logarithmic else (ticks(*x), ticks(*y))
        for value in upward:
            level = self.at(x[0], value)[1]
            drawing.line([(self.left, level), (self.right, level)], "grid-line")
            drawing.text(self.left - 6, level + 5, self.name(value, upward), "soft", "end")
        for value in across:
            place = self.at(value, y[0])[0]
            drawing.line([(place, self.top), (place, self.bottom)], "grid-line")
            if place > self.left + 12 or not logarithmic:
                drawing.text(place, self.bottom + 18, self.name(value, across), "soft", "middle")
        drawing.line([(self.left, self.top), (self.left, self.bottom), (self.right, self.bottom)], "rim-line")
        drawing.text(16, (self.top + self.bottom) / 2, up, "", "middle", turn=True)
        drawing.text((self.left + self.right) / 2, self.bottom + 36, along, "", "middle")
        drawing.y = self.bottom + 42

    @staticmethod
    def decades(span: tuple[float, float]) -> list[float]:
        return [10.0**power for power in range(-30, 30) if span[0] * 0.999 <= 10.0**power <= span[1] * 1.001]

    def name(self, value: float, all: list[float]) -> str:
        if self.logarithmic:
            power = round(log10(value))
            exponent = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
            return f"{value:g}" if -2 <= power <= 4 else f"10{exponent}"
        return label(value, all[1] - all[0] if len(all) > 1 else 1.0)

    def at(self, x: float, y: float) -> tuple[float, float]:
        def part(value: float, span: tuple[float, float]) -> float:
            if self.logarithmic:
                value, span = log10(value), (log10(span[0]), log10(span[1]))
            return (value - span[0]) / (span[1] - span[0])

        across, up = part(x, self.x_range), part(y, self.y_range)
        return self.left + across * (self.right - self.left), self.bottom - up * (self.bottom - self.top)

    def line(self, points: Points, kind: str) -> None:
        self.drawing.line([self.at(*point) for point in points], kind)

    def dots(self, points: Points, kind: str, size: float = 6) -> None:
        d = "".join(f"M{number(x)} {number(y)}h0" for x, y in (self.at(*point) for point in points))
        self.drawing.parts.append(
            f'<path class="{kind}" style="stroke-width:{number(size)};stroke-linecap:round" d="{d}"/>'
        )

    def bars(self, spans: Iterable[tuple[float, float, float]], kind: str) -> None:
        """Intervals: x, lower and upper end."""
        for x, low, high in spans:
            self.line([(x, low), (x, high)], kind)


def span(series: Iterable[Points], margin: float = 0.06) -> tuple[float, float]:
    """Of the second numbers of all points, with a margin."""
    values = [y for points in series for _, y in points]
    low, high = min(values), max(values)
    room = (high - low or 1.0) * margin
    return low - room, high + room
