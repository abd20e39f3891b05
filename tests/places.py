"""Folders that tests read."""

from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
DOCS, PROBLEMS = ROOT / "docs", ROOT / "problems"
SAVED = TESTS / "results"  # results of packaged scenes
