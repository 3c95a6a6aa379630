"""The statistics, on plain arrays: no table and no file is known here.

Rows are participants, columns scenes; what a participant didn't answer is NaN. Labelled
tables stand above, in `pourcast.comparison`.
"""
