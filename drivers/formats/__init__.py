"""Recordings of other programs: one file a format, ``registry.py`` has the table.

``read.py`` makes a Recording of any of them.  Nothing is imported here: the packages that read the formats are heavy.
"""
