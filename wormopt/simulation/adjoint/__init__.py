"""Derivatives of one number of a motion by everything the motion depends on."""
