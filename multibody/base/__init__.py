"""Tools for every other room: errors, units, threads, the cache folder, parameter files, progress.

To import from here: each name from the file of its subject.  Takes from no other room.
"""
