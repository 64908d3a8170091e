"""Values that no argument, or some argument, should take: numbers, junk, holders."""

import array
import math
import warnings
from collections import OrderedDict, UserList
from decimal import Decimal
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy import stats


def _function(*arguments: Any) -> float:
    return 1.0


def _nested(depth: int) -> Any:
    value: Any = [1.0]
    for _ in range(depth):
        value = [value]
    return value


def _matrix(a: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        return np.asmatrix(a)


def _read_only(a: Any) -> Any:
    copy = np.array(a)
    copy.flags.writeable = False
    return copy


NUMBERS = [
    *(math.nan, math.inf, -math.inf, 0, 0.0, -0.0, 1, -1, 2, 3, 0.5, -2.5, 7, 100),
    *(5e-324, -5e-324, 1e-300, 1e300, -1e300, 1.7e308, 2**31, 2**53 + 1, -(2**63)),
    *(2**63, 2**64, 10**30, -(10**30), 10**400, True, False, 1j, 2 + 0j, None, "1", ""),
    *(Fraction(1, 2), Decimal("0.5"), np.int8(3), np.uint64(2**63), np.bool_(True)),
    *(np.float16(2), np.float32(0.5), np.longdouble("1.1"), np.longdouble("1e4000")),
    *(np.longdouble("-1e-4000"), np.complex128(2), np.datetime64("2020"), np.str_("k")),
    *(np.float64(4), np.int64(4), np.float64("nan"), np.timedelta64(1, "s")),
    np.ma.masked,
]
JUNK = {
    "object()": object,
    "a lambda": lambda: _function,
    "a class": lambda: float,
    "a module": lambda: math,
    "NotImplemented": lambda: NotImplemented,
    "...": lambda: ...,
    "text": lambda: "k1",
    "bytes": lambda: b"k1",
    "a bytearray": lambda: bytearray(b"\1\2"),
    "[]": list,
    "()": tuple,
    "{}": dict,
    "set()": set,
    "[[]]": lambda: [[]],
    "[None]": lambda: [None],
    "[[1.0], []]": lambda: [[1.0], []],
    "[[1, 2], [3]]": lambda: [[1, 2], [3]],
    "['a', 'a']": lambda: ["a", "a"],
    "['']": lambda: [""],
    "[1, 'a']": lambda: [1, "a"],
    "{'a': 1.0}": lambda: {"a": 1.0},
    "{0: None}": lambda: {0: None},
    "{1.0, 2.0}": lambda: {1.0, 2.0},
    "a generator": lambda: (x for x in (1.0, 2.0)),
    "range(3)": lambda: range(3),
    "np.empty(0)": lambda: np.empty(0),
    "np.empty((0, 2))": lambda: np.empty((0, 2)),
    "np.empty((2, 0))": lambda: np.empty((2, 0)),
    "np.ones((1,) * 40)": lambda: np.ones((1,) * 40),
    "100 brackets": lambda: _nested(100),
    "an object array": lambda: np.array([None, 1.0], dtype=object),
    "a record": lambda: np.zeros(2, dtype="i4, f8"),
    "dates": lambda: np.array(["2020", "2021"], dtype="datetime64[Y]"),
    "np.ma.masked": lambda: np.ma.masked,
    "a DataFrame": lambda: pd.DataFrame({"a": [1.0], "b": ["x"]}),
    "an empty DataFrame": pd.DataFrame,
    "a Dataset": xr.Dataset,
    "array.array": lambda: array.array("d", [1.0, 2.0]),
    "a memoryview": lambda: memoryview(b"ab"),
    "a law, not frozen": lambda: stats.norm,
    "an exception": lambda: ValueError("no"),
}
DTYPES = ["int8", "int64", "uint32", "float16", "float32", "longdouble", ">f8"]
DTYPES += ["complex128", "bool", "U8", "S8", "object", "datetime64[s]"]
HOLDERS = {
    "list": lambda a: a.tolist(),
    "tuple": lambda a: tuple(a.tolist()),
    "UserList": lambda a: UserList(a.tolist()),
    "set": lambda a: set(a.ravel().tolist()),
    "iterator": lambda a: iter(a),
    "generator": lambda a: (x for x in a),
    "dict": lambda a: dict(enumerate(a)),
    "read-only": lambda a: _read_only(a),
    "stretched": lambda a: np.repeat(a, 2, axis=0)[::2],
    "Fortran": np.asfortranarray,
    "matrix": lambda a: _matrix(a),
    "masked array": np.ma.array,
    "masked entries": lambda a: np.ma.array(a, mask=np.arange(a.size) == a.size - 1),
    "recarray": lambda a: a.view(np.recarray),
    "DataArray": xr.DataArray,
    "DataFrame": pd.DataFrame,
    "Series": lambda a: pd.Series(a.ravel()),
    "nullable Series": lambda a: pd.Series(
        [*a.ravel().tolist()[1:], pd.NA], dtype="Float64"
    ),
    "array of arrays": lambda a: np.array([*a, None], dtype=object)[:-1],
    "array.array": lambda a: array.array("d", a.ravel().tolist()),
    "memoryview": lambda a: memoryview(np.ascontiguousarray(a, dtype=float)),
    "text": str,
}
MAPPINGS = {
    "OrderedDict": OrderedDict,
    "a proxy": lambda d: MappingProxyType(dict(d)),
    "items": lambda d: list(d.items()),
    "keys": list,
    "values": lambda d: list(d.values()),
    "a Series": lambda d: pd.Series(list(d.values()), index=list(d), dtype=object),
    "a set": set,
    "text": str,
    "None": lambda d: None,
    "empty": lambda d: {},
}
# What is thrown at every argument; the labels are those of malformed.py.
TELLING = {
    "item int -1",
    *(
        "bool True",
        "float 0.5",
        "float nan",
        "float inf",
        "int -1",
        "int 0",
        "float 0.0",
    ),
    *("NoneType None", "str '1'", "float 1e+300", "float 1e-300", "a generator"),
    *("{1.0, 2.0}", "[]", "text", "np.ma.masked", "float64 np.float64(4.0)"),
    *(f"entry {x}" for x in ("float nan", "float inf", "int -1", "int 0", "str '1'")),
    *(f"entry {x}" for x in ("float 1e+300", "float 1e-300", "NoneType None")),
    *("as complex128", "as bool", "as object", "as U8", "as float32", "as longdouble"),
    *("as set", "as generator", "as dict", "as masked entries", "as list"),
    *("without the last", "the last twice", "backwards", "columns backwards", "none"),
    *(
        "a row and a column less",
        "ragged",
        "the first alone",
        "in another axis",
        "all alike",
        "flat",
    ),
    *("times -1.0", "times 1e+200", "times 1e-200", "times 0.0"),
    *("a set", "a list's generator", "its first", "its text", "a tuple"),
    "the first again",
    *(
        "item str ''",
        "item int 3",
        "item int 1",
        "item float 1e+300",
        "a law, not frozen",
        "as keys",
        "as items",
        "as a proxy",
        "as empty",
    ),
}
