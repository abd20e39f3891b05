"""Problems judged one by one, a line of JSON for each: a judgement goes on where it was stopped."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def judged(
    file: str,
    count: int,
    judge: Callable[[int], dict[str, Any]],
    summary: Callable[[list[dict[str, Any]]], dict[str, Any]],
) -> None:
    """Judge the first `count` problems, but those of the file, and print what all say together."""
    path = Path(file)
    done = path.read_text().splitlines() if path.exists() else []
    for number in range(len(done), count):
        with path.open("a") as lines:
            lines.write(json.dumps(judge(number)) + "\n")
    print(json.dumps(summary([json.loads(x) for x in path.read_text().splitlines()]), indent=1))
