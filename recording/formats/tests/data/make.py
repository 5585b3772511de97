"""Makes the Parquet files of this folder: the same 24 raw samples in the encodings of pyarrow. Run with pyarrow 26: python make.py"""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

ROWS = range(24)
columns = {
    "sequence": pa.array([5 + 2 * row for row in ROWS], pa.uint64()),
    "timestamp_ns": pa.array([2_500_000 * row for row in ROWS], pa.int64()),
    "interval_ns": pa.array([2_500_000 for _ in ROWS], pa.uint64()),
}
for axis in (1, 2, 3):
    columns[f"a{axis}_positive"] = pa.array([100 + row % 3 for row in ROWS], pa.uint32() if axis < 3 else pa.int64())
    columns[f"a{axis}_negative"] = pa.array([row % 2 for row in ROWS], pa.uint32())
    columns[f"a{axis}_head"] = pa.array([1.5 + 0.25 * (row // 8) for row in ROWS])
    board = [None if row == 3 else 2.0 + 0.5 * row for row in ROWS]
    columns[f"a{axis}_board"] = pa.array(board, pa.float32() if axis == 2 else pa.float64())
for compression in ("snappy", "zstd", "none"):
    for dictionary in (True, False):
        name = f"{compression}-{'dictionary' if dictionary else 'plain'}.parquet"
        encodings = {"sequence": "DELTA_BINARY_PACKED", "a1_head": "BYTE_STREAM_SPLIT"}
        pq.write_table(
            pa.table(columns),
            Path(__file__).with_name(name),
            compression=compression,
            use_dictionary=dictionary,
            column_encoding=None if dictionary else encodings,
            data_page_version="2.0" if compression == "zstd" else "1.0",
            row_group_size=10,
            write_statistics=False,
            store_schema=False,
        )
