"""Names of the files a result is kept in, known without loading what reads and writes them."""

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"
STILL, MOVING = ("png", "pdf", "svg"), ("gif", "mp4")
"""Formats of pictures, as suffixes; the second of animations only."""


def picture_file(picture: str, form: str | None = None) -> str:
    """Name of the file for a picture, a word of ``want``, in the usual format or another."""
    return f"{picture}.{form or ('gif' if picture == 'animation' else 'png')}"
