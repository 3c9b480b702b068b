"""Files of an atlas give its numbers back: to numpy, to Octave and to a C program."""

from __future__ import annotations

import csv
import io
import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui import load
from simmer_tui.atlas.array_files import csv_bytes, mat_bytes, npz_bytes
from simmer_tui.atlas.c_header import header_bytes, table_bytes
from simmer_tui.atlas.expected_readings import Atlas, PoseGrid, compute_atlas
from simmer_tui.errors import AtlasError
from simmer_tui.sim import Simulator

PROGRAM = """
#include <stdio.h>
#include "atlas.h"
int main(void) {
  printf("%d %d %d %d %g\\n", ATLAS_ROWS, ATLAS_COLUMNS, ATLAS_HEADINGS, ATLAS_SENSORS, (double)ATLAS_STEP);
  for (int row = 0; row < ATLAS_ROWS; row++)
    for (int column = 0; column < ATLAS_COLUMNS; column++)
      for (int heading = 0; heading < ATLAS_HEADINGS; heading++) {
        printf("%d", atlas_free(row, column, heading));
        for (int sensor = 0; sensor < ATLAS_SENSORS; sensor++)
          printf(" %.9g", (double)atlas_reading(row, column, heading, sensor));
        printf("\\n");
      }
  return 0;
}
"""


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    """An atlas with misses: u2 and t1 do not see far."""
    spec = load().simulation
    sensors = [replace(each, max_range=20.0) if each.code == "u2" else each for each in spec.sensors]
    simulator = Simulator(replace(spec, sensors=tuple(sensors)))
    made = compute_atlas(simulator, PoseGrid.over(simulator.maze, 3.0, 5), ("u1", "u2", "t1"))
    assert np.isinf(made.ranges[..., 1:]).any(axis=(0, 1, 2)).all()
    return made


def test_numpy_reads_it_back(atlas: Atlas) -> None:
    with np.load(io.BytesIO(npz_bytes(atlas))) as read:
        assert sorted(read) == ["codes", "free", "heading", "ranges", "step", "x", "y"]
        assert read["ranges"].dtype == np.float32
        assert np.array_equal(read["ranges"], atlas.ranges)
        assert np.array_equal(read["free"], atlas.free)
        assert read["x"].tolist() == atlas.grid.x.tolist()
        assert read["y"].tolist() == atlas.grid.y.tolist()
        assert read["heading"].tolist() == [0, 72, 144, 216, 288]
        assert read["codes"].tolist() == ["u1", "u2", "t1"]
        assert read["step"] == 3.0


def test_a_table_of_text_has_the_same_numbers(atlas: Atlas) -> None:
    rows = list(csv.reader(csv_bytes(atlas).decode("ascii").splitlines()))
    assert rows[0] == ["x_in", "y_in", "heading_deg", "free", "u1", "u2", "t1"]
    values = np.array(rows[1:], dtype=np.float64)
    grid = atlas.grid
    assert values[:, :3].tolist() == [pose for row in range(grid.rows) for pose in grid.row(row).tolist()]
    assert np.array_equal(values[:, 3], atlas.free.ravel())
    assert np.array_equal(values[:, 4:].astype(np.float32), atlas.ranges.reshape(-1, 3))


def test_octave_reads_it_back(atlas: Atlas, tmp_path: Path) -> None:
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("octave-cli is not installed")
    (tmp_path / "atlas.mat").write_bytes(mat_bytes(atlas))
    # Row by row as in the arrays of numpy: the last index fastest.
    program = (
        "load atlas.mat; printf('%d ', grid, size(ranges), step, x, y, heading);"
        "printf('%s ', cellstr(codes){:});"
        "ranges = reshape(ranges, [grid 3]); free = reshape(free, grid); printf('\\n');"
        "printf('%.9g ', permute(ranges, [4 3 2 1])); printf('\\n'); printf('%d ', permute(free, [3 2 1]));"
    )
    ended = subprocess.run(
        [octave, "--norc", "--eval", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    first, ranges, free = ended.stdout.splitlines()
    grid = atlas.grid
    words = first.split()
    assert words[-3:] == ["u1", "u2", "t1"]
    lines = (grid.x, grid.y, grid.heading)
    sizes = [grid.rows, grid.columns, grid.headings, grid.poses, 3, 3.0, *np.concatenate(lines)]
    assert list(map(float, words[:-3])) == sizes
    assert np.array_equal(np.array(ranges.split(), np.float32), atlas.ranges.ravel())
    assert free.split() == [str(int(each)) for each in atlas.free.ravel()]


def compiled(atlas: Atlas, folder: Path, compiler: str = "cc", language: str = "c") -> list[str]:
    """Output of a program in C that reads the header of an atlas."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    (folder / "atlas.h").write_bytes(header_bytes(atlas))
    (folder / "program.c").write_text(PROGRAM)
    strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", f"-std={'c99' if language == 'c' else 'c++11'}"]
    command = [compiler, *strict, "-x", language, "-o", "program", "program.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    ended = subprocess.run([str(folder / "program")], capture_output=True, text=True, check=True)
    return ended.stdout.splitlines()


def as_counts(atlas: Atlas, unit: float = 0.5) -> np.ndarray:
    """The readings rounded to the header's unit."""
    return np.rint(atlas.ranges / np.float32(unit)) * np.float32(unit)


@pytest.mark.parametrize(("compiler", "language"), [("cc", "c"), ("c++", "c++")])
def test_a_c_program_reads_it_back(atlas: Atlas, tmp_path: Path, compiler: str, language: str) -> None:
    sizes, *lines = compiled(atlas, tmp_path, compiler, language)
    assert sizes == "16 32 5 3 3"
    rows = np.array([line.split() for line in lines], np.float32)
    assert np.array_equal(rows[:, 0], atlas.free.ravel())
    assert np.array_equal(rows[:, 1:], as_counts(atlas).reshape(-1, 3))
    assert table_bytes(atlas) == 2560 * 3 + 320


def test_no_array_of_the_header_is_larger_than_an_arduino_takes(tmp_path: Path) -> None:
    simulator = Simulator(load().simulation)
    atlas = compute_atlas(simulator, PoseGrid.over(simulator.maze, 2.0, 36), ("u1",))
    text = header_bytes(atlas).decode("ascii")
    sizes = [int(line.partition("[")[2].partition("]")[0]) for line in text.splitlines() if "] ATLAS" in line]
    assert sizes == [32_000, 9_472, 5_184]
    rows = np.array([line.split() for line in compiled(atlas, tmp_path)[1:]], np.float32)
    assert np.array_equal(rows, np.column_stack((atlas.free.ravel(), as_counts(atlas).ravel())))


def test_readings_beyond_127_in_have_a_larger_unit_of_their_own(atlas: Atlas, tmp_path: Path) -> None:
    ranges = atlas.ranges.copy()
    ranges[..., 0] *= 3
    ranges[0, 0, 0] = (254.4, 127.2, math.inf)
    far = replace(atlas, ranges=ranges)
    rows = np.array([line.split()[1:] for line in compiled(far, tmp_path)[1:]], np.float32)
    assert rows[0].tolist() == [254.0, 127.0, math.inf]
    assert np.array_equal(rows[:, 0], as_counts(far, 1.0)[..., 0].ravel())
    assert np.array_equal(rows[:, 1:], as_counts(far)[..., 1:].reshape(-1, 2))


def test_a_reading_below_0_has_no_byte(atlas: Atlas) -> None:
    ranges = atlas.ranges.copy()
    ranges[1, 2, 3, 1] = -4.5
    with pytest.raises(AtlasError, match=r"u2 reads -4\.5 at a pose, .*: leave it out of --sensors"):
        header_bytes(replace(atlas, ranges=ranges))


def test_codes_of_any_characters_break_no_file(atlas: Atlas, tmp_path: Path) -> None:
    odd = replace(atlas, codes=('",', "*/", "u1"))
    assert next(csv.reader(csv_bytes(odd).decode("ascii").splitlines()))[4:] == ['",', "*/", "u1"]
    rows = np.array([line.split()[1:] for line in compiled(odd, tmp_path)[1:]], np.float32)
    assert np.array_equal(rows, as_counts(odd).reshape(-1, 3))
    assert "#define ATLAS_u1 2\n" in (tmp_path / "atlas.h").read_text("ascii")
    with np.load(io.BytesIO(npz_bytes(odd))) as read:
        assert tuple(read["codes"]) == odd.codes


@pytest.mark.parametrize("form", [npz_bytes, mat_bytes, csv_bytes, header_bytes])
def test_the_same_atlas_makes_the_same_bytes(atlas: Atlas, form: Callable[[Atlas], bytes]) -> None:
    again = replace(atlas, ranges=np.asfortranarray(atlas.ranges), free=atlas.free.copy())
    assert form(atlas) == form(again)
