"""Whether what cannot be is refused, and by a reason that names what to change."""

from __future__ import annotations

import math
from collections.abc import Callable

from wormopt.errors import WormoptError


def refused(call: Callable[[], object], *words: str) -> float:
    """0 if a call is refused by a reason with all of these words, else infinite."""
    try:
        call()
    except WormoptError as error:
        return 0.0 if all(word in str(error) for word in words) else math.inf
    return math.inf
