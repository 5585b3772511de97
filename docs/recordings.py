#!/usr/bin/env python3
"""Reads one recording in its two formats with other programs' libraries, and compares them value by value.

    pip install pandas mcap mcap-protobuf-support
    python3 docs/recordings.py flight        # flight.csv, flight.increments.csv and flight.mcap of imu-a
"""
import math
import sys

import pandas
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

name = sys.argv[1]
imu = sys.argv[2] if len(sys.argv) > 2 else "imu-a"


def messages(topic):
    with open(f"{name}.mcap", "rb") as file:
        try:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            found = list(reader.iter_decoded_messages(topics=[topic]))
        except Exception:  # not ended: without a summary it is read from its beginning
            file.seek(0)
            reader, found = NonSeekingReader(file, decoder_factories=[DecoderFactory()]), []
            try:
                for message in reader.iter_decoded_messages(topics=[topic], log_time_order=False):
                    found.append(message)
            except Exception as error:
                print(f"{name}.mcap is not whole: {type(error).__name__}", file=sys.stderr)
    for _, _, message, decoded in found:
        # Unix time, where the timestamps are of CLOCK_MONOTONIC.
        assert message.publish_time in (decoded.timestamp_ns, decoded.timestamp_ns + decoded.unix_offset_ns)
        assert message.log_time == decoded.recorded_ns
        yield {field.name: getattr(decoded, field.name) for field in decoded.DESCRIPTOR.fields}


def same(a, b):
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


for stream, suffix in (("raw", ""), ("increment", ".increments")):
    csv = pandas.read_csv(f"{name}{suffix}.csv", dtype=str, keep_default_na=False)
    mcap = list(messages(f"isotherm/{imu}/{stream}"))
    columns = list(csv.columns)
    assert all(list(row) == columns for row in mcap)
    # When it was taken is each recorder's own, and so is how well it knows the offset of Unix time.
    columns = [column for column in columns if column not in ("recorded_ns", "unix_offset_ns", "unix_offset_uncertainty_ns")]
    assert len(csv) == len(mcap), (len(csv), len(mcap))
    for one, two in zip(csv[columns].to_dict("records"), mcap):
        for column in columns:
            assert same(type(two[column])(one[column]), two[column]), (column, one, two)
    print(f"{name} {stream}: {len(mcap)} rows, the same in both")
