"""Export of results to other tools: CSV, MATLAB, C, ROS, FMI; one module for each format.

A format makes the contents of its files, by name; `files.py` chooses folders and names.
"""
