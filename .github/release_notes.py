"""Check a tag and print the notes of its release.

``python .github/release_notes.py v0.2.0`` ends with an error unless the tag,
pyproject.toml, CITATION.cff and the newest heading of CHANGELOG.md name one version,
and the last two one date.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main(tag: str, root: Path = ROOT) -> str:
    """Return the newest section of CHANGELOG.md."""

    def read(name: str) -> str:
        return (root / name).read_text(encoding="utf-8")

    cited = dict(
        re.findall(r"^(version|date-released): (\S+)$", read("CITATION.cff"), re.M)
    )
    version = tomllib.loads(read("pyproject.toml"))["project"]["version"]
    _, *sections = re.split(r"^## (?=\[)", read("CHANGELOG.md"), flags=re.M)
    heading, _, notes = sections[0].partition("\n")
    expected = f"[{version}] - {cited.get('date-released')}"
    if tag != f"v{version}" or cited["version"] != version or heading != expected:
        raise SystemExit(
            f"expected one version and date, got the tag {tag}, pyproject.toml "
            f"{version}, CITATION.cff {cited}, CHANGELOG.md {heading!r}"
        )
    return notes.strip()


if __name__ == "__main__":
    print(main(sys.argv[1]))
