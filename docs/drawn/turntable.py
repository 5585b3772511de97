"""An IMU in three dimensions: on the turntable, in its positions, and in a tumble."""

import tomllib
from math import cos, radians, sin

from .chart import Drawing
from .command import ROOT, picture

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

    def arc(
        self, centre: Vector, radius: float, about: int, first_deg: float, last_deg: float
    ) -> list[tuple[float, float]]:
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
                corners.append(self.at(moved((corner[0], corner[1], corner[2]))))
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
    drawing = Drawing(
        "A two-axis turntable: the outer axis is horizontal, the inner axis turns with it, both are right-handed"
    )
    scene = Scene(drawing, 225, 205, 62)
    for side in (-1, 1):
        # A pedestal, and the bearing of the outer axis on it.
        feet = [
            (side * 2.35, 0.3, -1.9),
            (side * 2.35, -0.3, -1.9),
            (side * 2.35, -0.3, 0.25),
            (side * 2.35, 0.3, 0.25),
        ]
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
    for line in (
        "Positive angles are right-handed about their axes. At outer 0",
        "and inner 0 this mounting has A1 along the outer axis, A3 up.",
    ):
        drawing.y += 19
        drawing.text(12, drawing.y, line, "small")
    return drawing.svg()


@picture("positions")
def _() -> str:
    campaign = tomllib.loads((ROOT / "examples/campaign/campaign.toml").read_text())
    drawing = Drawing("The twelve positions of the example campaign: each axis up and down, at two headings")
    drawing.heading(
        "Twelve positions: six faces, two headings",
        "With the angles of the outer and the inner axis.",
        "Each accelerometer points up twice and down twice.",
    )
    top = drawing.y
    for k, position in enumerate(campaign["position"]):
        x, y = 64 + 124 * (k % 4), top + 74 + 172 * (k // 4)
        m = turned(position["outer_deg"], position["inner_deg"])
        # The file states the direction that the angles give.
        assert all(abs(a - b) < 1e-9 for a, b in zip(m[2], position["specific_force"], strict=True)), position
        Scene(drawing, x, y, 27).imu(m)
        sign, axis = position["up"]
        drawing.text(
            x,
            y + 78,
            f"{position['number']}: A{'xyz'.index(axis) + 1} {'up' if sign == '+' else 'down'}",
            "bold small",
            "middle",
        )
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
