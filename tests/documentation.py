"""The text of the README and of the pages of the documentation."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
PAGES = sorted((ROOT / "teleop_drake" / "docs").glob("*.md"))
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in (README, *PAGES))


def Blocks(language: str) -> list[str]:
    """Returns the blocks of code in that language, the README's first."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
    return [text for name, text in blocks if name == language]
