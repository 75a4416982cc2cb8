"""The columns of a Parquet file."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError
from estimation.files.table import FileTable, column_faults, present_columns, table_from_arrays

__all__ = ["read_parquet"]


def read_parquet(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> FileTable:
    """Read columns of a Parquet file; see `estimation.files.read_table.read_table`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = path.name
    try:
        file = pq.ParquetFile(path)
        names = list(file.schema_arrow.names)
        columns = present_columns(columns, names, optional)
        if faults := column_faults(name, [*columns, *labels], names):
            raise RecordError(faults)
        count = len(dict.fromkeys([*columns, *labels]))
        check_size(name, 8.0 * file.metadata.num_rows * count, path.stat().st_size)
        table = file.read(columns=[*columns, *labels])
    except (pa.ArrowException, OSError) as error:
        raise RecordError([f"{name}: is not a readable Parquet file ({str(error).splitlines()[0]})"]) from error
    if table.num_rows == 0:
        raise RecordError([f"{name}: there are columns but no rows"])
    return table_from_arrays(path, names, columns, labels, lambda column: table[column].to_numpy())
