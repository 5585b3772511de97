#!/usr/bin/env python3
"""Makes the pictures of the documents, docs/pictures/*.svg, with the command `isotherm` that is on PATH.

    cargo build --release && PATH=$PWD/target/release:$PATH python3 docs/pictures.py

Names make some of them. `--check` compares them with the files in place of writing them. The same version of the
command makes the same files on every machine.
"""

import argparse
import sys

sys.dont_write_bytecode = True

from drawn import latency, overview, reports, screen, simulated, thermal_run, turntable  # noqa: E402, F401
from drawn.command import FOLDER, PICTURES  # noqa: E402


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--check", action="store_true", help="compare, and write nothing")
    arguments.add_argument("--screen", action="store_true", help="take the screens of isotherm top and of a report anew")
    arguments.add_argument("name", nargs="*", choices=[[], *PICTURES], help="picture, without .svg")
    options = arguments.parse_args()
    if options.screen:
        screen.take_top()
        screen.take_report()
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
