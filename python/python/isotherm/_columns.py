"""Tables of columns, of pandas and of Arrow, as the conversions to records read them. Imports neither by itself."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as _pa  # type: ignore[import-untyped]


class Columns(Protocol):
    """The columns of a table."""

    names: list[str]
    count: int
    """The number of rows."""

    def values(self, name: str) -> npt.NDArray[Any]:
        """The values of a column; a missing number is NaN."""

    def texts(self, name: str) -> tuple[npt.NDArray[np.integer[Any]], Sequence[object]]:
        """The different texts of a column, and the index of that of each row; -1 where it is missing."""


class PandasColumns:
    """The columns of a data frame of pandas."""

    def __init__(self, frame: pd.DataFrame) -> None:
        self.names, self.count, self._frame = [str(name) for name in frame.columns], len(frame), frame

    def values(self, name: str) -> npt.NDArray[Any]:
        column = self._frame[name]
        if column.hasnans:
            return column.to_numpy(dtype=np.float64, na_value=np.nan)
        # The extension types of pandas would give objects.
        given = getattr(column.dtype, "numpy_dtype", None)
        return column.to_numpy() if given is None else column.to_numpy(dtype=given)

    def texts(self, name: str) -> tuple[npt.NDArray[np.integer[Any]], Sequence[object]]:
        import pandas as pd

        rows, texts = pd.factorize(self._frame[name])
        return rows, list(texts)


class ArrowColumns:
    """The columns of a table of Arrow."""

    def __init__(self, table: _pa.Table) -> None:
        self.names, self.count, self._table = list(table.column_names), table.num_rows, table

    def values(self, name: str) -> npt.NDArray[Any]:
        return self._table[name].to_numpy()  # type: ignore[no-any-return]

    def texts(self, name: str) -> tuple[npt.NDArray[np.integer[Any]], Sequence[object]]:
        import pyarrow as pa

        column = self._table[name]
        if not pa.types.is_dictionary(column.type):
            # Not every type of texts can be encoded.
            column = (column.cast(pa.large_string()) if "string" in str(column.type) else column).dictionary_encode()
        places: dict[object, int] = {}
        rows = [np.empty(0, np.int64)]
        for chunk in column.chunks:
            of_chunk = [places.setdefault(text, len(places)) for text in chunk.dictionary.to_pylist()]
            rows.append(np.array([*of_chunk, -1])[chunk.indices.cast(pa.int64()).fill_null(-1).to_numpy(zero_copy_only=False)])
        return np.concatenate(rows), list(places)


def is_frame(values: object) -> bool:
    """Whether `values` is a pandas data frame. Does not import pandas."""
    pandas = sys.modules.get("pandas")
    return pandas is not None and isinstance(values, pandas.DataFrame)


def is_arrow(values: object) -> bool:
    """Whether `values` is a table of Arrow, or of a library that gives its tables as such, as polars."""
    # A column has the stream, too, and no columns.
    return hasattr(values, "__arrow_c_stream__") and (hasattr(values, "columns") or hasattr(values, "schema")) and not is_frame(values)


def needed(package: str, what: str, extra: str) -> ImportError:
    """The exception of a function that needs a package which is not installed."""
    return ImportError(f"{what} needs {package}, which is not installed: pip install 'isotherm[{extra}]', or pip install {package}", name=package)


def arrow_table(values: Any) -> _pa.Table:
    """A table of Arrow, of any object that has the Arrow stream of a table."""
    try:
        import pyarrow as pa
    except ImportError:
        raise needed("pyarrow", "a table of Arrow", "arrow") from None
    return values if isinstance(values, pa.Table) else pa.table(values)


def columns_of(values: object) -> Columns | None:
    """The columns of a data frame or of a table of Arrow; None for everything else."""
    if is_frame(values):
        return PandasColumns(values)  # type: ignore[arg-type]
    return ArrowColumns(arrow_table(values)) if is_arrow(values) else None
