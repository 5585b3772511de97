#!/usr/bin/env python3
"""The digest of a coefficient table, from its description in table.md and nothing else. Python 3.11 or later.

    docs/digest.py TABLE.toml ...        prints "sha256:.. FILE" for each
"""
import hashlib
import struct
import sys
import tomllib


def number(value):
    return struct.pack(">d", float(value) + 0.0).hex()


def text(value):
    return value.encode().hex()


def canonical(table):
    imu, temperature = table["imu"], table["temperature"]
    lines = ["isotherm-table 1", "imu.id " + text(imu["id"])]
    if "serial" in imu:
        lines.append("imu.serial " + text(imu["serial"]))
    lines.append("imu.gravity " + number(imu["gravity"]))
    lines.append("temperature.unit " + text(temperature["unit"]))
    lines.append("temperature.out_of_range " + text(temperature["out_of_range"]))
    if "max_age_s" in temperature:
        lines.append("temperature.max_age_s " + number(temperature["max_age_s"]))
    for axis in table["axis"]:
        name = "axis." + axis["name"]
        if "max_rate" in axis:
            lines.append(f"{name}.max_rate {number(axis['max_rate'])}")
        for quantity in ("bias", "positive_scale_factor", "negative_scale_factor"):
            polynomial = axis[quantity]
            coefficients = [polynomial[f"c{k}"] for k in range(8) if f"c{k}" in polynomial]
            lines.append(f"{name}.{quantity}.unit {text(polynomial['unit'])}")
            lines.append(f"{name}.{quantity}.range " + " ".join(map(number, polynomial["range"])))
            lines.append(f"{name}.{quantity}.center {number(polynomial.get('center', 0.0))}")
            lines.append(f"{name}.{quantity}.scale {number(polynomial.get('scale', 1.0))}")
            lines.append(f"{name}.{quantity}.coefficients " + " ".join(map(number, coefficients)))
    if "alignment" in table:
        lines.append("alignment.matrix " + " ".join(number(m) for row in table["alignment"]["matrix"] for m in row))
    return "".join(line + "\n" for line in lines)


for path in sys.argv[1:]:
    with open(path, encoding="utf-8-sig") as file:
        table = tomllib.loads(file.read())
    print("sha256:" + hashlib.sha256(canonical(table).encode()).hexdigest(), path)
