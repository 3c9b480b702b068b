"""Import of configuration sets from teams' files: a simmer-python `config.py`, or a MATLAB `Main.m` with its
`config` folder."""
