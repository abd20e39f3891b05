"""Optimal control: problems, transcription, contact treatments, nonlinear programs, phases."""
