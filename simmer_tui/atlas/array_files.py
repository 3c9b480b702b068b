"""An atlas as files of arrays: .npz for numpy, .mat for MATLAB and Octave, .csv for all else.

The same atlas makes the same bytes, on every machine with the same zlib.
"""

from __future__ import annotations

import csv
import io
import struct
import zipfile

import numpy as np

from simmer_tui.atlas.expected_readings import Atlas
from simmer_tui.errors import AtlasError
from simmer_tui.sim.arrays import NDArray

# `create_system` of a zip file: 3 is Unix, on every machine, so that the bytes are the same.
_UNIX = 3
# A level 4 matrix stores its sizes as signed numbers of four bytes.
_MOST_BYTES = 2**31 - 1
# Precision, the tens digit of a level 4 matrix's type.
_PRECISIONS = {"float64": 0, "float32": 10, "uint8": 50}
_TEXT = 1


def npz_bytes(atlas: Atlas) -> bytes:
    """The file for `numpy.load`: `ranges` and `free` as in `Atlas`, `x`, `y`, `heading`, `codes`, `step`."""
    grid = atlas.grid
    arrays: dict[str, NDArray[np.generic]] = {
        "ranges": atlas.ranges,
        "free": atlas.free,
        "x": grid.x,
        "y": grid.y,
        "heading": grid.heading,
        "codes": np.array(atlas.codes),
        "step": np.array(grid.step),
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            # Its date is 1980: today's date would change the bytes of the same atlas.
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, _UNIX
            data = io.BytesIO()
            np.lib.format.write_array(
                data, array.astype(array.dtype.newbyteorder("<"), order="C"), allow_pickle=False
            )
            archive.writestr(entry, data.getvalue())
    return file.getvalue()


def mat_bytes(atlas: Atlas) -> bytes:
    """The file for `load` of MATLAB and Octave, of level 4, which has only matrices. `ranges` is (poses,
    sensors) and `free` (poses, 1), rows fastest, so that `reshape(ranges(:, 1), grid)` is a sensor's array.
    `grid` is [rows columns headings].

    Source of the layout: "MAT-File Format", The MathWorks, "Level 4 MAT-File Format". Raises AtlasError
    above 2 GB.
    """
    grid = atlas.grid
    if atlas.ranges.nbytes > _MOST_BYTES:
        raise AtlasError("a .mat file of this kind holds 2 GB: take --format npz")
    count = len(atlas.codes)
    codes = np.array([[*map(ord, code.ljust(max(map(len, atlas.codes))))] for code in atlas.codes])
    return b"".join(
        (
            _matrix("ranges", atlas.ranges.reshape(-1, count, order="F")),
            _matrix("free", atlas.free.reshape(-1, 1, order="F").astype(np.uint8)),
            _matrix("x", grid.x[None, :]),
            _matrix("y", grid.y[None, :]),
            _matrix("heading", grid.heading[None, :]),
            _matrix("grid", np.array([[grid.rows, grid.columns, grid.headings]], np.float64)),
            _matrix("step", np.array([[grid.step]])),
            _matrix("codes", codes.astype(np.float64), _TEXT),
        )
    )


def _matrix(name: str, values: NDArray[np.generic], sort: int = 0) -> bytes:
    """One level 4 matrix: little-endian, column by column."""
    kind = _PRECISIONS[values.dtype.name] + sort
    header = struct.pack("<5i", kind, *values.shape, 0, len(name) + 1)
    columns = values.astype(values.dtype.newbyteorder("<")).tobytes(order="F")
    return header + name.encode("ascii") + b"\0" + columns


def csv_bytes(atlas: Atlas) -> bytes:
    """A line a pose, in the order of the arrays. Numbers have the fewest digits that restore them exactly."""
    grid = atlas.grid
    head = io.StringIO()
    # A code may have a comma or a quote in it.
    csv.writer(head, lineterminator="").writerow(("x_in", "y_in", "heading_deg", "free", *atlas.codes))
    lines = [head.getvalue()]
    headings = [f"{heading:.10g}" for heading in grid.heading.tolist()]
    columns = [f"{x:.10g}" for x in grid.x.tolist()]
    for index, y in enumerate(grid.y.tolist()):
        readings = iter(atlas.ranges[index].reshape(-1, len(atlas.codes)).astype(str).tolist())
        free = iter(atlas.free[index].ravel().astype(int).tolist())
        for x in columns:
            start = f"{x},{y:.10g}"
            lines += [f"{start},{each},{next(free)},{','.join(next(readings))}" for each in headings]
    return "\n".join((*lines, "")).encode("ascii")
