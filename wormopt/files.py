"""Names of the files a result is kept in, known without loading what reads and writes them."""

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"


def picture_file(picture: str) -> str:
    """Name of the file for a picture, a word of ``want``."""
    return f"{picture}.gif" if picture == "animation" else f"{picture}.png"
