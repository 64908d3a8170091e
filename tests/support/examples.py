"""The examples as modules."""

import importlib.util
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
EXAMPLES = TESTS.parent / "examples"


def load(name):
    """Return an example, a benchmark or else a page of that name as a fresh module."""
    found = sorted(EXAMPLES.rglob(f"{name}.py"))
    path = min(found, key=lambda p: (p.parent != EXAMPLES, p.parent.name))
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))  # as for a script, which sees its neighbours
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    return module
