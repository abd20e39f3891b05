"""The version, kept apart so that every module may read it without importing the package."""

VERSION = "0.1.0"
