"""The judgement of one malformed argument: refused by name, or right.

Whether it should be refused is not asked of the package: each argument states what it
accepts, by the predicates of ``kinds.py``.
"""

import dataclasses
import math
import re
import signal
from collections import UserList, defaultdict
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from support.kinds import numbers
from support.malformed import Bent, bent_values

SHARE = 0.8  # of what is planned; some releases of hypothesis repeat values
HANG = 10.0  # seconds for one call; the slowest takes milliseconds
WRITTEN = (list, tuple, bytearray, UserList)  # as a list they mean the same
LISTS = (list, tuple, range, UserList)
THROWN: dict[str, set[Any]] = defaultdict(set)  # distinct ones, by target


class Hang(BaseException):
    """A call that did not return; no ``except Exception`` swallows it."""


@dataclass(frozen=True)
class Argument:
    """A valid value, and which others are valid too (None: it cannot be said).

    What is ``long`` is not thrown: valid, but as slow or large as it asks for.
    """

    valid: Any
    accepts: Callable[[Any], bool | None]
    long: Callable[[Any], bool] | None = None

    def malformed(self) -> tuple[list[Bent], list[list[Bent]]]:
        """Return what is thrown always, and what is thrown at random, in groups."""
        kept = [
            [bent for bent in group if not (self.long and self.long(bent()))]
            for group in bent_values(self.valid)
        ]
        others = [[bent for bent in group if not bent.telling] for group in kept]
        telling = [bent for group in kept for bent in group if bent.telling]
        return telling, [group for group in others if group]


@dataclass(frozen=True)
class Target:
    """A public callable and its arguments.

    ``probe`` turns a result into what is compared: by default its own fields. ``words``
    may begin a message besides the names of the arguments, and ``alias`` gives the word
    for an argument that has another name in it; a refusal by the result, when probed,
    may begin with one of ``late``. Of ``tied`` arguments, whose sizes must
    agree, either may be named. ``truth`` is an independent route to the same numbers,
    from plain float64 arguments.
    """

    call: Callable[..., Any]
    arguments: Mapping[str, Argument]
    fixed: Mapping[str, Any] = field(default_factory=dict)
    probe: Callable[[Any], Any] = lambda result: result
    truth: Callable[..., Any] | None = None
    words: tuple[str, ...] = ()
    alias: Mapping[str, str] = field(default_factory=dict)
    tied: tuple[str, ...] = ()
    late: tuple[str, ...] = ()
    examples: int = 20

    @property
    def planned(self) -> int:
        """The number of malformed inputs, all of them different."""
        return sum(
            len(telling) + min(self.examples, sum(map(len, others)))
            for telling, others in (own.malformed() for own in self.arguments.values())
        )


def judge(target: Target, argument: str, build: Callable[[], Any]) -> None:
    """Throw one malformed value at one argument, and judge what comes back."""
    others = {**target.fixed, **{k: a.valid for k, a in target.arguments.items()}}
    expected = target.arguments[argument].accepts(build())
    done = False
    try:
        with stopped(HANG):
            made = target.call(**{**others, argument: build()})
            done = True
            result = target.probe(made)
    except (TypeError, ValueError, UserWarning) as error:
        late = (
            done
            and expected is not False
            and str(error).startswith(target.late or "\0")
        )
        assert late or names(target, argument, str(error)), f"names no one: {error!r}"
        assert expected is not True, f"refused although valid: {error!r}"
        return
    assert expected is not False, f"accepted although invalid: {result!r}"
    others[argument] = plain(build())
    again = target.probe(target.call(**others))
    assert same(result, again), f"{result!r} instead of {again!r}"
    if target.truth is not None and expected:
        np.testing.assert_allclose(result, target.truth(**others), rtol=1e-9, atol=1e-9)


def names(target: Target, argument: str, message: str) -> bool:
    """Return whether a message begins with an argument, and names the bent one."""
    first = re.match(r"\w+", message)
    own = {*target.arguments, *target.words, *target.alias.values()}
    blamed = {argument, target.alias.get(argument, argument)}
    if argument in target.tied:
        blamed |= {*target.tied}
    said = any(re.search(rf"\b{word}\b", message) for word in blamed)
    return bool(first and first[0] in own and said)


def throw(target: Target, name: str) -> None:
    """Throw malformed values at every argument of a target, each of them once."""
    for argument, own in target.arguments.items():
        telling, others = own.malformed()
        thrown = _thrown(target, name, argument, others)
        for bent in telling:
            thrown = example(bent)(thrown)
        thrown()


def _thrown(target: Target, name: str, argument: str, others: list[list[Bent]]) -> Any:
    """Return the property of one argument, of the values that are not telling."""

    @settings(
        max_examples=target.examples,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],  # a bent value is as small as it gets
        deadline=None,  # measures a hang that has ended; ``stopped`` ends it
        suppress_health_check=[*HealthCheck],
    )
    @given(st.one_of([st.sampled_from(group) for group in others]))
    def thrown(bent: Bent) -> None:
        judge(target, argument, bent)
        THROWN[name].add((argument, bent.label))

    return thrown


@contextmanager
def stopped(seconds: float) -> Any:
    """End what takes longer; where the system has no alarm, wait."""

    def end(*_: Any) -> None:
        raise Hang(f"no result after {seconds} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def plain(value: Any) -> Any:
    """Return the same as float64 arrays, lists and dicts, where it is that."""
    if isinstance(value, np.integer) and not isinstance(value, np.timedelta64):
        return int(value)
    if isinstance(value, int | str | None) or callable(value):
        return value
    found = numbers(value)
    if found is not None and np.asarray(value).dtype.kind in "iu":
        whole = np.asarray(value).astype(np.int64)
        return whole.tolist() if isinstance(value, WRITTEN) else whole
    if found is not None:
        return found
    if isinstance(value, dict | MappingProxyType):
        return {
            key: [*map(plain, item)] if isinstance(item, LISTS) else plain(item)
            for key, item in value.items()
        }
    return value


def same(a: Any, b: Any) -> bool:
    """Return whether two results hold the same bits."""
    if dataclasses.is_dataclass(a) and type(a) is type(b):
        return same(vars(a), vars(b))
    if isinstance(a, Mapping):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        if a.dtype.kind not in "fc":
            return a.dtype == b.dtype and np.array_equal(a, b)
        # Sums over arrays of another layout round in another order.
        alike = a.shape == b.shape and np.allclose(a, b, 1e-9, 0.0, equal_nan=True)
        return bool(a.dtype == b.dtype and alike)
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-9) or a is b or (a != a and b != b)
    return a is b or a == b or repr(a) == repr(b)


def properties(targets: Mapping[str, Target]) -> Callable[..., None]:
    """Return the test that throws at every target."""

    @pytest.mark.parametrize("name", targets)
    def test_a_malformed_argument_is_refused_by_name_or_gives_the_right_result(name):
        throw(targets[name], name)
        assert len(THROWN[name]) >= SHARE * targets[name].planned

    return test_a_malformed_argument_is_refused_by_name_or_gives_the_right_result


def arguments(**given: tuple[Any, ...]) -> dict[str, Argument]:
    """Return arguments by name, each a valid value and what else is accepted."""
    return {name: Argument(*pair) for name, pair in given.items()}
