"""Imports configuration sets from what teams have: a simmer-python `config.py`, or a MATLAB `Main.m`
with its `config` folder."""
