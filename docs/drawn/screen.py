"""Screens: `isotherm top`, and the beginning of a report. Each shows one moment: `--screen` takes them anew.

docs/pictures/top.txt is the text of the screen, from which the picture is drawn. report.png needs chromium.
"""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import time

from .chart import Drawing
from .command import FOLDER, ROOT, isotherm, picture, scratch

SCREEN = FOLDER / "top.txt"
COLUMNS, ROWS = 80, 22


def shown(output: str) -> str:
    """The characters on a terminal after this output."""
    cells: dict[tuple[int, int], str] = {}
    row = column = 1
    for private, numbers, letter, character in re.findall(r"\x1b\[(\??)([\d;]*)([A-Za-z])|([^\x1b])", output):
        if character:
            cells[row, column] = character
            column += 1
        elif letter == "H" and not private:
            row, column = (int(number) for number in numbers.split(";"))
        elif letter == "J":
            cells.clear()
    lines = ["".join(cells.get((row, column), " ") for column in range(1, COLUMNS + 1)) for row in range(1, ROWS + 1)]
    return "".join(line.rstrip() + "\n" for line in lines)


def take_top() -> None:
    """Serves and feeds a simulated IMU, and keeps what `isotherm top` shows after 15 s."""
    place = scratch()
    environment = {**os.environ, "ISOTHERM_DOMAIN": "vehicle", "ISOTHERM_ROOT": str(place), "TERM": "xterm-256color"}
    isotherm("simulate", "run", "--gyroscopes", "--imu", "imu-a", "--interval", "1", "-o", "flight")
    (place / "service.toml").write_text(
        '[latency]\nbudget_us = 1000\n[[imu]]\nid = "imu-a"\ntable = "flight/truth.toml"\n'
    )
    commands = [
        ["serve", "--config", "service.toml"],
        ["feed", "--imu", "imu-a", "--rate", "400", "flight/run.csv", "-o", "a.csv"],
    ]
    running = []
    for command in commands:
        null = subprocess.DEVNULL
        running.append(subprocess.Popen(["isotherm", *command], cwd=place, env=environment, stdout=null, stderr=null))
        time.sleep(2)
    process, terminal = pty.fork()
    if process == 0:
        os.execvpe("isotherm", ["isotherm", "top"], environment)
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    os.kill(process, signal.SIGWINCH)
    output, end = b"", time.monotonic() + 15
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            output += os.read(terminal, 65536)
    os.write(terminal, b"q")
    os.waitpid(process, 0)
    for program in reversed(running):
        program.terminate()
        program.wait()
    subprocess.run(["isotherm", "clean"], cwd=place, env=environment, check=True, capture_output=True)
    SCREEN.write_text(shown(output.decode()))


def take_report() -> None:
    """Opens the report of the example campaign in a browser, and keeps what is seen first."""
    campaign = f"{ROOT}/examples/campaign/campaign.toml"
    isotherm("calibrate", "turntable", campaign, "-o", "imu.toml", "--report", "calibrate.html")
    words = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"]
    words += ["--disable-background-networking", "--blink-settings=preferredColorScheme=1", "--window-size=820,780"]
    words += [f"--user-data-dir={scratch()}/profile", f"--screenshot={FOLDER}/report.png"]
    subprocess.run([*words, f"file://{scratch()}/calibrate.html"], check=True, capture_output=True, timeout=120)


@picture("top")
def _() -> str:
    drawing = Drawing("The screen of isotherm top: rates, latency, temperatures and flags of an IMU", 590)
    drawing.y = 14
    for line in SCREEN.read_text().splitlines():
        drawing.y += 17
        drawing.text(12, drawing.y - 4, line, "mono")
    return drawing.svg()
