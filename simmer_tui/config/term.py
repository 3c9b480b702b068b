"""The folder of a course: a set with its mission, samples, and further files for a repository of students.

Files that are not made from others are in the folder `term` of the bundled sets, under the names of the
copies.
"""

from __future__ import annotations

from collections.abc import Mapping

from simmer_tui.config.examples import EXAMPLE, example_files
from simmer_tui.config.sets import LOCAL_FOLDER, bundled_folder, unreadable
from simmer_tui.version import requirement

SAMPLES, SUBMISSION = "samples", "submission"
"""Folders of the sample programs and of students' submissions."""
PROGRAM = "main.py"
"""The program in a submission that is run."""
_TEMPLATE = "term"
_REQUIREMENTS = "requirements.txt"


def term_files(course_set: Mapping[str, bytes]) -> dict[str, bytes]:
    """The files of a course's folder, by path in it, around the files of its set.

    Raises ConfigurationError if a bundled file cannot be read.
    """
    samples = example_files()
    files = {f"{LOCAL_FOLDER}/{name}": data for name, data in course_set.items()}
    files |= {f"{SAMPLES}/{name}": data for name, data in samples.items()}
    files[f"{SUBMISSION}/{PROGRAM}"] = samples[EXAMPLE]
    files |= _template()
    files[_REQUIREMENTS] += f"{requirement()}\n".encode()
    return files


def _template() -> dict[str, bytes]:
    """The bundled files, by path."""
    folder = bundled_folder() / _TEMPLATE
    try:
        found = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}
    except OSError as error:
        raise unreadable(error, folder) from None
