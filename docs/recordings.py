#!/usr/bin/env python3
"""Reads one recording in its three formats with other programs' libraries, and compares them value by value; verifies the checks of
CSV and Parquet, which other programs ignore.

    pip install pyarrow pandas mcap mcap-protobuf-support
    python3 docs/recordings.py flight        # flight.csv, flight.increments.csv, flight.parquet, .., flight.mcap of imu-a
"""
import math
import sys
import zlib

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
        # Unix time, where the timestamps are of CLOCK_MONOTONIC.
        assert message.publish_time in (decoded.timestamp_ns, decoded.timestamp_ns + decoded.unix_offset_ns)
        assert message.log_time == decoded.recorded_ns
        yield {field.name: getattr(decoded, field.name) for field in decoded.DESCRIPTOR.fields}


def verify_csv(path):
    """Each row ends with the CRC-32 of its text before the last comma."""
    with open(path, "rb") as file:
        next(file)
        for number, line in enumerate(file, 2):
            row, check = line.rstrip(b"\r\n").rsplit(b",", 1)
            assert f"{zlib.crc32(row):08x}".encode() == check, (path, number)


def verify_parquet(path):
    """The metadata have the CRC-32 of the bytes of each column of each row group."""
    metadata = pyarrow.parquet.read_metadata(path)
    groups = metadata.metadata[b"isotherm.check"].decode().split(";")
    with open(path, "rb") as file:
        for group, checks in enumerate(groups):
            for column, check in enumerate(checks.split(",")):
                chunk = metadata.row_group(group).column(column)
                begin = chunk.dictionary_page_offset or chunk.data_page_offset
                file.seek(begin)
                assert f"{zlib.crc32(file.read(chunk.total_compressed_size)):08x}" == check, (path, group, column)


def same(a, b):
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


for stream, suffix in (("raw", ""), ("increment", ".increments")):
    parquet = pyarrow.parquet.read_table(f"{name}{suffix}.parquet")
    whole = {field.name: "uint64" if str(field.type).startswith("uint") else str for field in parquet.schema if str(field.type) != "double"}
    csv = pandas.read_csv(f"{name}{suffix}.csv", dtype=whole | {"check": str}).drop(columns="check")
    verify_csv(f"{name}{suffix}.csv")
    verify_parquet(f"{name}{suffix}.parquet")
    types = {str(field.type) for field in parquet.schema}
    assert types <= {"uint64", "uint32", "double", "string"}, types
    assert parquet.schema.metadata[b"isotherm.imu"].decode() == imu
    mcap = list(messages(f"isotherm/{imu}/{stream}"))
    columns = list(csv.columns)
    assert columns == parquet.column_names and all(list(row) == columns for row in mcap)
    # When it was taken is each recorder's own, and so is how well it knows the offset of Unix time.
    columns = [column for column in columns if column not in ("recorded_ns", "unix_offset_ns", "unix_offset_uncertainty_ns")]
    rows = [csv[columns].to_dict("records"), parquet.select(columns).to_pylist(), mcap]
    assert len({len(part) for part in rows}) == 1, [len(part) for part in rows]
    for one, two, three in zip(*rows):
        for column in columns:
            assert same(one[column], two[column]) and same(two[column], three[column]), (column, one, two, three)
    print(f"{name} {stream}: {len(mcap)} rows, the same in all three")
