"""What was found, for other tools: CSV, MATLAB, C, ROS, FMI; one module for each format.

A format makes the contents of its files, by their names; `files.py` puts them in their place.
"""
