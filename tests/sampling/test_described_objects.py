"""Values in a fingerprint: the same in every process, and no change escapes it."""

import collections
import dataclasses
import enum
import functools
import json
import os
import subprocess
import sys
import threading
import types
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse, stats
from test_described_code import SOURCES, compiled, of, used

from emcee_femu.sampling.fingerprint import differences

BIG = np.arange(1000.0)


class Colour(enum.Enum):
    RED, BLUE = 1, 2


@dataclasses.dataclass(frozen=True)
class Part:
    E: float
    inside: object = None


class Point(collections.namedtuple("Point", ("x", "y"))):
    pass


class Plain:
    def __init__(self, **attributes):
        vars(self).update(attributes)


class Slots:
    __slots__ = ("a", "b")

    def __init__(self, a):
        self.a = a


class Named(dict):
    scale = 1.0


class Solver:
    """A user's model that counts its calls, and says that this is not its state."""

    def __init__(self, k):
        self.k, self.calls = k, 0

    def __getstate__(self):
        return {"k": self.k}

    def frequencies(self, parameters):
        self.calls += 1
        return [self.k * parameters["a"]]


class Lazy(Plain):
    @functools.cached_property
    def square(self):
        return self.k**2


def named(**attributes):
    result = Named(a=1)
    vars(result).update(attributes)
    return result


def closure(k):
    def f(p):
        return p * k

    return f


def add(a, b=0.0):
    return a + b


def masked(hidden):
    return np.ma.MaskedArray(BIG, mask=BIG == hidden)


def record(value):
    return np.array([(1, value)], dtype=[("node", "i4"), ("x", "f8")])


def nudged(array, index):
    result = array.copy()
    result[index] = np.nextafter(result[index], np.inf)
    return result


def nested(value):
    return {"a": [Part(1.0, Plain(x=(Point(1.0, [BIG, {"k": value}]),)))]}


def histogram(*data):
    return stats.rv_histogram(np.histogram(data, bins=3))()


CHANGES = {
    "the last bit of one number": (BIG, nudged(BIG, 500), "value"),
    "one number of few": (np.ones(3), np.array([1.0, 2.0, 1.0]), "value"),
    "type of an array": (np.ones(3), np.ones(3, np.float32), "value"),
    "shape of an array": (np.ones((2, 3)), np.ones((3, 2)), "value"),
    "shape of a long array": (BIG, BIG.reshape(10, 100), "value"),
    "long double": (np.longdouble(BIG), np.longdouble(BIG) + 1e-17, "value"),
    "last bit of a float": (0.1, np.nextafter(0.1, 1), "value"),
    "int and float": (1, 1.0, "value"),
    "sign of zero": (0.0, -0.0, "value"),
    "a bool": (True, np.bool_(False), "value"),
    "a name": ("k1", "k2", "value"),
    "end of a long text": ("k" * 999 + "1", "k" * 999 + "2", "value"),
    "an enumeration": (Colour.RED, Colour.BLUE, "value"),
    "a set": ({"a", "b"}, {"a", "c"}, "value"),
    "an entry": ([1, (2.0, "x")], [1, (2.0, "y")], "value"),
    "tuple and list": ((1, 2), [1, 2], "value"),
    "an entry of many": ([Part(i) for i in range(200)],
                         [Part(i + (i == 150)) for i in range(200)], "value"),
    "order of a dict": ({"a": 1, "b": 2}, {"b": 2, "a": 1}, "value"),
    "an item": ({"a": 1, "b": 2}, {"a": 1, "b": 3}, "value[b]"),
    "a key": ({"a": 1}, {"b": 1}, "value"),
    "type of a key": ({1: 1}, {"1": 1}, "value"),
    "items 1 and '1'": ({1: 1, "1": 2}, {1: 1, "1": 3}, "value[1]'"),
    "a deep number": (nested(1), nested(2), "value[a][0].inside.x[0].y[1][k]"),
    "a field of a named tuple": (Point(1, 2), Point(1, 3), "value.y"),
    "an attribute": (Plain(a=1), Plain(a=2), "value.a"),
    "an attribute more": (Plain(a=1), Plain(a=1, b=2), "value.b"),
    "a slot": (Slots(1), Slots(2), "value.a"),
    "type of an object": (Plain(a=1), types.SimpleNamespace(a=1), "value"),
    "attribute of a dict": (named(scale=2.0), named(scale=3.0), "value.scale"),
    "a deque": (collections.deque([1, Part(2)]), collections.deque([1, Part(3)]),
                "value(2).E"),
    "an array of objects": (np.array([Part(1), None]), np.array([Part(2), None]),
                            "value.items[0].E"),
    "a field of records": (record(1.0), record(2.0), "value[x]"),
    "a masked number": (masked(3), masked(4), "value.mask"),
    "a sparse number": (sparse.eye(9) * 2.0, sparse.eye(9) * 3.0, "value"),
    "a sparse place": (sparse.eye(9, k=1), sparse.eye(9, k=-1), "value"),
    "a path": (Path("a"), Path("b"), "value"),
    "a ufunc": (np.exp, np.log, "value"),
    "a function of a library": (np.linalg.eigh, np.linalg.eigvalsh,
                                "value(name)"),
    "a built-in function": (len, max, "value(name)"),
    "a closure": (closure(1.0), closure(2.0), "value(closure).k"),
    "argument of a partial": (functools.partial(add, b=1.0),
                              functools.partial(add, b=2.0), "value[b]"),
    "position of a partial": (functools.partial(add, 1.0), functools.partial(add, 2.0),
                              "value[0]"),
    "object of a method": (Solver(1.0).frequencies, Solver(2.0).frequencies,
                           "value(self).k"),
    "cached function": (functools.cache(closure(1)), functools.cache(closure(2)),
                        "value(wrapped)(closure).k"),
    "arguments of a distribution": (stats.norm(0, 1), stats.norm(0, 2), "value.args"),
    "scale of a distribution": (stats.norm(scale=1), stats.norm(scale=2),
                                "value.kwds[scale]"),
    "a distribution": (stats.norm(0, 1), stats.logistic(0, 1), "value.dist"),
    "data of a distribution": (histogram(1, 2, 3), histogram(1, 3, 3),
                               "value.dist._hpdf"),
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_a_value_is_seen_and_named(change):
    one, other, path = CHANGES[change]
    lines = differences(of(one), of(other))
    assert lines and lines[0].startswith(f"{path}: ")


def asked(lazy):
    assert lazy.square == 9.0
    return lazy


def drawn(distribution):
    distribution.random_state = np.random.default_rng(3)
    distribution.rvs(5)
    return distribution


SAME = {
    "the order in memory": (np.ones((20, 30)), np.ones((20, 30), order="F")),
    "a view": (BIG[::2].copy(), BIG[::2]),
    "numbers of NumPy": (1.5, np.float64(1.5)),
    "order of a set": ({"a", "b", "c"}, {"c", "b", "a"}),
    "what is not the state": (
        Solver(1.0).frequencies,
        used(Solver(1.0).frequencies, {"a": 1}),
    ),
    "a cached property": (Lazy(k=3.0), asked(Lazy(k=3.0))),
    "a random stream": (np.random.default_rng(1), np.random.default_rng(2)),
    "padding of long doubles": (
        np.frombuffer(bytes(16) * 20, np.longdouble),
        np.frombuffer((bytes(10) + b"ABCDEF") * 20, np.longdouble),
    ),
    "a frozen distribution that was drawn from": (
        stats.norm(0, 1),
        drawn(stats.norm(0, 1)),
    ),
}


@pytest.mark.parametrize("case", SAME)
def test_what_does_not_change_the_posterior_does_not_count(case):
    one, other = SAME[case]
    assert differences(of(one), of(other)) == []


def everything():
    """Return the fingerprint of all values above."""
    values = [v for *pair, _ in CHANGES.values() for v in pair]
    values += [compiled(s) for *pair, _ in SOURCES.values() for s in pair]
    return of(values)


def test_the_same_construction_gives_the_same_in_every_process():
    here = everything()
    code = "import json, test_described_objects as t; print(json.dumps(t.everything()))"
    for hash_seed in ("1", "2"):
        there = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert differences(here, json.loads(there)) == []


def test_cycles_and_entangled_objects_end():
    nodes = [Plain(number=i) for i in range(300)]
    for node in nodes:
        node.others = nodes
    first = of(nodes)
    assert first == of(nodes)
    nodes[-1].number = 0
    assert differences(first, of(nodes))[0].startswith("value: ")
    chain = None
    for i in range(5_000):  # deeper than Python's stack
        chain = Plain(i=i, before=chain)
    assert of(chain)["value.before.before.i"] == "4997"


def test_equal_parts_may_be_one_object_or_copies():
    shared = BIG.copy()
    assert of([shared, shared]) == of([shared, shared.copy()])
    part = Part(1.0)
    assert of({"a": part, "b": part})["value[b]"] == "as value[a]"


def test_what_cannot_be_looked_into_says_so():
    found = of(Plain(lock=threading.Lock(), k=1))
    assert found["value.lock"] == "_thread.lock (not looked into)"
    assert found["value.k"] == "1"
    held = Plain(k=1)
    held.__reduce_ex__ = None  # cannot be pickled, but has attributes
    assert of(held)["value.k"] == "1"
