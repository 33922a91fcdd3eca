"""What is finished of a long benchmark, in a file of JSON lines: a run that was ended goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

#: What a laboratory is known by: seed and whatever else tells it from others.
Key = tuple[Any, ...]


class Records:
    """Answers by their keys, of plain values; kept in a file where one is named."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.known: dict[Key, Any] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                if line.endswith("}"):  # the last one may have been cut
                    entry = json.loads(line)
                    self.known[tuple(entry["key"])] = entry["answer"]

    def keep(self, key: Key, answer: Any) -> None:
        """One more."""
        self.known[key] = answer
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, "answer": answer}) + "\n")
