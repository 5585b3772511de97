#!/usr/bin/env python3
"""Reads one recording in its three formats with other programs' libraries, and compares them value by value.

    pip install pyarrow pandas mcap mcap-protobuf-support
    python3 docs/recordings.py flight        # flight.csv, flight.increments.csv, flight.parquet, .., flight.mcap of imu-a
"""
import math
import sys

import pandas
import pyarrow.parquet
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
        assert message.publish_time == decoded.timestamp_ns and message.log_time == decoded.recorded_ns
        yield {field.name: getattr(decoded, field.name) for field in decoded.DESCRIPTOR.fields}


def same(a, b):
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


for stream, suffix in (("raw", ""), ("increment", ".increments")):
    parquet = pyarrow.parquet.read_table(f"{name}{suffix}.parquet")
    whole = {field.name: "uint64" if str(field.type).startswith("uint") else str for field in parquet.schema if str(field.type) != "double"}
    csv = pandas.read_csv(f"{name}{suffix}.csv", dtype=whole)
    types = {str(field.type) for field in parquet.schema}
    assert types <= {"uint64", "uint32", "double", "string"}, types
    assert parquet.schema.metadata[b"isotherm.imu"].decode() == imu
    mcap = list(messages(f"isotherm/{imu}/{stream}"))
    columns = list(csv.columns)
    assert columns == parquet.column_names and all(list(row) == columns for row in mcap)
    # When it was taken is each recorder's own.
    columns.remove("recorded_ns")
    rows = [csv[columns].to_dict("records"), parquet.select(columns).to_pylist(), mcap]
    assert len({len(part) for part in rows}) == 1, [len(part) for part in rows]
    for one, two, three in zip(*rows):
        for column in columns:
            assert same(one[column], two[column]) and same(two[column], three[column]), (column, one, two, three)
    print(f"{name} {stream}: {len(mcap)} rows, the same in all three")
