"""Labelled tables: responses and models' judgments in, what they say of one another out.

The numbers come from `pourcast.statistics`; here they get names, rows and columns.
"""
