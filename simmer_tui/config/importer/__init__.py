"""Foreign configurations: a simmer-python `config.py`, or a MATLAB `Main.m` with its `config` folder.

In: those files, read as data and never executed.
Out: a set's files, with what was assumed or could not be taken.
"""
