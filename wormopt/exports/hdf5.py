"""HDF5: a whole result, its variables with units and dimension scales."""

from __future__ import annotations

import io

import numpy as np

from wormopt.exports.common import optional
from wormopt.exports.matlab import texts_of, value_of
from wormopt.files import MARK
from wormopt.result import Result


def make(result: Result, stem: str) -> dict[str, bytes]:
    """``STEM.h5`` with groups ``variables`` and ``scalars``, and texts, trust as JSON."""
    h5py = optional("h5py", "hdf5")
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for name, text in texts_of(result).items():
            file[name] = text
        file["mark"] = np.frombuffer(MARK.encode(), np.uint8)  # data have no checksum
        for name, scalar in result.scalars.items():
            dataset = file.create_dataset(f"scalars/{name}", data=value_of(scalar.value))
            dataset.attrs["units"] = scalar.unit
        group = file.create_group("variables")
        for variable in result.variables:
            dataset = group.create_dataset(variable.name, data=variable.values)
            dataset.attrs.update(units=variable.unit, long_name=variable.long_name)
            if variable.dims == (variable.name,):
                dataset.make_scale(variable.name)
        for variable in result.variables:
            for axis, dim in zip(group[variable.name].dims, variable.dims, strict=True):
                axis.label = dim
                if dim in group and group[dim].is_scale and dim != variable.name:
                    axis.attach_scale(group[dim])
    return {f"{stem}.h5": stream.getvalue()}
