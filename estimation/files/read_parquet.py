"""The columns of a Parquet file."""

from __future__ import annotations

from pathlib import Path

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError
from estimation.files.table import FileTable, TableRequest, column_faults, present_columns, table_from_arrays

__all__ = ["read_parquet"]


def read_parquet(path: Path, request: TableRequest) -> FileTable:
    """Read columns of a Parquet file; see `estimation.files.read_table.read_table`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = path.name
    try:
        file = pq.ParquetFile(path)
        names = list(file.schema_arrow.names)
        request = present_columns(request, names)
        if faults := column_faults(name, request.every, names):
            raise RecordError(faults)
        check_size(name, 8.0 * file.metadata.num_rows * len(request.every), path.stat().st_size)
        table = file.read(columns=list(request.every))
    except (pa.ArrowException, OSError) as error:
        raise RecordError(
            [f"{name}: is not a readable Parquet file ({str(error).splitlines()[0]}): export it again"]
        ) from error
    if request.every and table.num_rows == 0:
        raise RecordError([f"{name}: there are columns but no rows"])
    return table_from_arrays(path, names, request, lambda column: table[column].to_numpy())
