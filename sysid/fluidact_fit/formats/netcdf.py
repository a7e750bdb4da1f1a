"""Classic netCDF files."""

from __future__ import annotations

from typing import Any

import numpy as np

from .sink import Sink, library
from .tables import add_array, add_packed


def read(path: str, sink: Sink) -> None:
    """Hand over the variables of a classic netCDF file."""
    netcdf_file = library("scipy.io").netcdf_file
    sink.dialect = "netCDF"
    with netcdf_file(path, "r", mmap=False, maskandscale=False) as file:
        sizes: list[int] = [v.shape[0] for v in file.variables.values() if len(v.shape) == 1]
        for name, variable in file.variables.items():
            values: Any = np.array(variable.data)
            if values.dtype.kind == "S":
                add_array(sink, name, values)
                continue
            native = values.astype(values.dtype.newbyteorder("="))
            add_packed(sink, name, native, dict(variable._attributes), samples=sizes)
