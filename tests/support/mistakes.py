"""Mistakes that users make, by the kind of argument, and other ways to write it.

A kind maps labels to functions of a valid value: what is ``wrong`` must be refused by
the argument's name, what is ``alike`` must give the same result.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

Bend = Callable[[Any], Any]
PLAIN = {"None": None, "a word": "word", "1.5": 1.5, "True": True, "NaN": np.nan}
PLAIN |= {"[]": [], "{'x': None}": {"x": None}, "an object": object()}
REFUSALS = (TypeError, ValueError, ImportError, FileNotFoundError)


def constants(**values: Any) -> dict[str, Bend]:
    return {k: v if callable(v) else lambda _, v=v: v for k, v in values.items()}


@dataclass(frozen=True)
class Kind:
    wrong: Mapping[str, Bend]
    alike: Mapping[str, Bend] = field(default_factory=dict)

    def but(self, *labels: str, **wrong: Any) -> "Kind":
        """Return a kind without some labels, and with more that is wrong."""
        kept = {k: v for k, v in self.wrong.items() if k not in labels}
        alike = {k: v for k, v in self.alike.items() if k not in labels}
        return Kind(kept | constants(**wrong), alike)


anything = Kind(constants(**PLAIN))
file = anything.but("a word", empty="", standard_input=0)
text = anything.but("a word", empty="", bytes=b"word")
flag = Kind(anything.but("True", zero=0, no="no").wrong, {"of NumPy": np.bool_})


def number(low: float | None = None, above: float | None = None) -> Kind:
    kind = anything.but("1.5", infinite=np.inf, numeral="1.0", complex=1j, two=[1, 2])
    if low is not None:
        kind = kind.but(low=low - 1e-3)
    if above is not None:
        kind = kind.but(limit=above, beyond=above - 1.0)
    return Kind(kind.wrong, {"of NumPy": np.float64, "an array": np.array})


def whole(low: int = 0) -> Kind:
    wrong = anything.but(numeral="1", float=float, list=lambda v: [v], low=low - 1)
    return Kind(wrong.wrong, {"of NumPy": np.int64})


names = Kind(
    anything.wrong
    | {
        "one empty": lambda v: [*v[:-1], ""],
        "one twice": lambda v: [*v[:-1], v[0]],
        "numbers": lambda v: [*range(len(v))],
        "a set": set,
        "one less": lambda v: v[:-1],
        "one more": lambda v: [*v, "one more"],
    },
    {"tuple": tuple, "array": np.array, "Index": pd.Index},
)
wholes = Kind(
    anything.wrong
    | {
        "floats": lambda v: [float(i) for i in v],
        "numerals": lambda v: [str(i) for i in v],
        "booleans": lambda v: [True] * len(v),
        "negative": lambda v: [*v[:-1], -1],
        "one twice": lambda v: [*v[:-1], v[0]],
        "in two rows": lambda v: [v, v],
    },
    {"tuple": tuple, "array": np.array, "Series": pd.Series},
)


def array(positive: bool = False, shaped: bool = True) -> Kind:
    """Floats, perhaps all above zero; ``shaped`` ones have but one valid shape."""

    def ends_with(number: float) -> Bend:
        return lambda v: np.append(v.flat[:-1], number).reshape(v.shape)

    wrong = anything.but("1.5").wrong | {
        "with NaN": ends_with(np.nan),
        "infinite": ends_with(np.inf),
        "masked": lambda v: np.ma.masked_equal(v, v.flat[-1]),
        "numerals": lambda v: v.astype(str),
        "booleans": lambda v: v > 0,
        "complex": lambda v: v + 1j,
        "with a hole": lambda v: np.where(v == v.flat[0], None, v),
        "ragged": lambda v: [*v.tolist(), [1.0, [2.0]]],
        "text beside": lambda v: pd.DataFrame({"x": ["a"] * len(v), "y": 1.0}),
        "empty": lambda v: v[:0],
        "in more axes": lambda v: v[None, None],
    }
    if shaped:
        wrong |= {"one less": lambda v: v[:-1], "one number": lambda v: 1.5}
    if positive:
        wrong |= {"negative": np.negative, "zero": np.zeros_like, "0": ends_with(0.0)}
    alike = {
        "lists": np.ndarray.tolist,
        "by columns": lambda v: np.array(v, order="F"),
        "DataArray": xr.DataArray,
        "pandas": lambda v: {1: pd.Series, 2: pd.DataFrame}.get(v.ndim, np.array)(v),
        "integers": lambda v: v.astype(int) if (v == v.round()).all() else v,
    }
    return Kind(wrong, alike)


def by_name(kind: Kind, every: bool = False, known: bool = True) -> Kind:
    """A mapping of names to values of a kind; perhaps of every name, or known ones."""

    def first(v: Any) -> Any:
        return next(iter(v.values()))

    def inside(bends: Mapping[str, Bend]) -> dict[str, Bend]:
        return {
            f"in it {label}": lambda v, bend=bend: {**v, next(iter(v)): bend(first(v))}
            for label, bend in bends.items()
        }

    wrong = anything.wrong | inside(kind.wrong)
    wrong["pairs"] = lambda v: [*v.items()]
    wrong["values"] = lambda v: [*v.values()]
    wrong["numbered"] = lambda v: dict(enumerate(v.values()))
    if known:
        wrong["unknown"] = lambda v: {**v, "k99": first(v)}
    if every:
        wrong["none"] = lambda v: {}
        wrong["one less"] = lambda v: dict([*v.items()][1:])
    return Kind(wrong, inside(kind.alike))


def find_faults(
    call: Callable[..., Any], valid: Mapping[str, Any], name: str, kind: Kind, tied: str
) -> list[str]:
    """Return which mistakes are taken, or refused without the name of the argument.

    A message may name an argument that is ``tied`` to it by its size instead.
    """
    faults = []
    for label, bend in kind.wrong.items():
        try:
            result = call(**{**valid, name: bend(valid[name])})
            faults.append(f"{label}: taken, with {result!r}")
        except REFUSALS as error:
            if not any(word in str(error) for word in (name, *tied.split())):
                faults.append(f"{label}: the argument is not named: {error!r}")
        except Exception as error:
            faults.append(f"{label}: not refused but failed: {error!r}")
    expected = call(**valid) if kind.alike else None
    for label, bend in kind.alike.items():
        result = call(**{**valid, name: bend(valid[name])})
        alike = isinstance(result, np.ndarray) and np.allclose(result, expected, 1e-9)
        if not (alike or _show(result) == _show(expected)):
            faults.append(f"{label}: {result!r} instead of {expected!r}")
    return [fault[:300] for fault in faults]


def _show(value: Any) -> str:
    """Return what an object holds, without where it is in memory."""
    return re.sub(" at 0x[0-9a-f]+", "", repr(getattr(value, "__dict__", value)))
