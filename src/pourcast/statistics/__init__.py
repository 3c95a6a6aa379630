"""The statistics, on plain arrays: this is the ground floor, and knows no table and no file.

Rows are participants, columns scenes; what a participant didn't answer is NaN. Labelled
tables stand above, in `pourcast.comparison`.
"""
