"""The version, kept apart so that every module may read it without importing the package."""

VERSION = "1.0.0rc1"
