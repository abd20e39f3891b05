"""Names of the files a result is kept in, known without loading what reads and writes them."""

RESULT_FILE = "result.nc"
SUMMARY_FILE = "summary.json"
TABLE_FILE = "table.md"


def picture_file(picture: str) -> str:
    """Name of the file a picture goes to.

    Parameters
    ----------
    picture : str
        Name of the picture, a word of ``want``.

    Examples
    --------
    >>> picture_file("gait"), picture_file("animation")
    ('gait.png', 'animation.gif')
    """
    return f"{picture}.gif" if picture == "animation" else f"{picture}.png"
