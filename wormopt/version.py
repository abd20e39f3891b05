"""The version, in a module that others may read without importing the package."""

VERSION = "1.0.0rc1"
