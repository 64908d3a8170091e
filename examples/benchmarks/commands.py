"""What the benchmarks share: options and tables.

The options of a benchmark are the arguments of its ``main``:
``python examples/benchmarks/evidence.py --help`` lists them.
"""

import argparse
import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from emcee_femu.table import Table


def command(main: Callable[..., object]) -> None:
    """Call a function with what the command line gives; the rest are its defaults."""
    parser = argparse.ArgumentParser(
        description=inspect.getmodule(main).__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, argument in inspect.signature(main).parameters.items():
        default = argument.default
        several = isinstance(default, tuple)
        parser.add_argument(
            f"--{name}",
            type=type(default[0] if several else default),
            nargs="+" if several else None,
            default=default,
            help=f"default: {' '.join(map(str, default)) if several else default}",
        )
    main(**vars(parser.parse_args()))


def tabulate(title: str, formats: Mapping[str, str], rows: Iterable[Any]) -> Table:
    """Print each row as soon as it is there, then the table, and return it."""
    found = []
    for row in rows:
        found.append(tuple(row))
        print(*found[-1], file=sys.stderr, flush=True)
    table = Table(title, tuple(formats), tuple(formats.values()), tuple(found))
    print(table)
    return table
