"""Imports configuration sets from what teams have: a simmer-python `config.py`, or a MATLAB `Main.m`
with its `config` folder."""

from simmer_tui.importer.files import read_path
from simmer_tui.importer.imported import Imported
from simmer_tui.importer.matlab import read_matlab
from simmer_tui.importer.set_writer import write_set
from simmer_tui.importer.simmer_python import read_simmer_python

__all__ = ["Imported", "read_matlab", "read_path", "read_simmer_python", "write_set"]
