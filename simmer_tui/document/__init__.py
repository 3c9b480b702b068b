"""Documents: tables of typed values, prose and figures.

In: values with their columns, and text.
Out: the same as terminal text, HTML, JSON or CSV.
"""
