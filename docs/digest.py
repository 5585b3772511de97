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


def numbers(values):
    return " ".join(map(number, values))


def matrix(section):
    return numbers(m for row in section["matrix"] for m in row)


def sensor(name, sensor):
    """The lines of an accelerometer or a gyroscope."""
    lines = []
    if "max_rate" in sensor:
        lines.append(f"{name}.max_rate {number(sensor['max_rate'])}")
    for quantity in ("bias", "positive_scale_factor", "negative_scale_factor"):
        polynomial = sensor[quantity]
        coefficients = [polynomial[f"c{k}"] for k in range(8) if f"c{k}" in polynomial]
        lines.append(f"{name}.{quantity}.unit {text(polynomial['unit'])}")
        lines.append(f"{name}.{quantity}.range {numbers(polynomial['range'])}")
        lines.append(f"{name}.{quantity}.center {number(polynomial.get('center', 0.0))}")
        lines.append(f"{name}.{quantity}.scale {number(polynomial.get('scale', 1.0))}")
        lines.append(f"{name}.{quantity}.coefficients {numbers(coefficients)}")
        if polynomial.get("transient", 0.0) != 0.0:
            lines.append(f"{name}.{quantity}.transient {number(polynomial['transient'])}")
    if "g_sensitivity" in sensor:
        lines.append(f"{name}.g_sensitivity {numbers(sensor['g_sensitivity'][key] for key in ('a1', 'a2', 'a3'))}")
    return lines


def canonical(table):
    imu, temperature = table["imu"], table["temperature"]
    lines = [f"isotherm-table {table['format']:.0f}", "imu.id " + text(imu["id"])]
    if "serial" in imu:
        lines.append("imu.serial " + text(imu["serial"]))
    lines.append("imu.gravity " + number(imu["gravity"]))
    if "nominal_interval_s" in imu:
        lines.append("imu.nominal_interval_s " + number(imu["nominal_interval_s"]))
    lines.append("temperature.unit " + text(temperature["unit"]))
    lines.append("temperature.out_of_range " + text(temperature["out_of_range"]))
    if "max_age_s" in temperature:
        lines.append("temperature.max_age_s " + number(temperature["max_age_s"]))
    if "lag" in table:
        lines.append("lag.time_constant_s " + number(table["lag"]["time_constant_s"]))
    for axis in table["axis"]:
        lines += sensor("axis." + axis["name"], axis)
    if "alignment" in table:
        lines.append("alignment.matrix " + matrix(table["alignment"]))
    for gyroscope in table.get("gyroscope", []):
        lines += sensor("gyroscope." + gyroscope["name"], gyroscope)
    if "gyroscope_alignment" in table:
        lines.append("gyroscope_alignment.matrix " + matrix(table["gyroscope_alignment"]))
    return "".join(line + "\n" for line in lines)


for path in sys.argv[1:]:
    with open(path, encoding="utf-8-sig") as file:
        table = tomllib.loads(file.read())
    print("sha256:" + hashlib.sha256(canonical(table).encode()).hexdigest(), path)
