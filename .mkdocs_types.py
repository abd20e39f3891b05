"""Types in docstrings, as the pages of the Python API show them."""

import re
from typing import Any

import griffe


class Types(griffe.Extension):
    """Reads the types of numpydoc that are no Python as words instead of tuples and calls."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Write "ndarray of shape (n,)" and "A or B or C"."""
        if obj.docstring:
            text = obj.docstring.value.replace(", shape (", " of shape (")
            obj.docstring.value = re.sub(
                r"(?m)^(\s*(?:[\w, ]+ : )?)(\w+)((?:, \w+)+ or \w+(?:, optional)?)$",
                lambda found: found[1] + found[2] + re.sub(r", (?!optional)", " or ", found[3]),
                text,
            )
