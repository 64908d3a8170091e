"""What each test's own posterior says, read from its ArviZ object."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Floats
from ..results.arviz_objects import dataset, samples

FEWEST = 100  # draws of a test


class Drawn(NamedTuple):
    """The draws of one test.

    Attributes:
        theta: The pooled parameters, ``(S, d)``.
        others: The rest of its parameters, ``(S, p)``.
        log_prior: Of the pooled parameters alone, ``(S,)``.
        log_rest: Log-posterior less ``log_prior``: likelihood and the others' prior.
        bounds: Of the pooled parameters, ``(d, 2)``.
        prior: Their mean and standard deviation under the prior, ``(2, d)``.
    """

    theta: Floats
    others: Floats
    log_prior: Floats
    log_rest: Floats
    bounds: Floats
    prior: Floats


def read_tests(tests: Any, names: tuple[str, ...], number: int) -> dict[str, Drawn]:
    """Return the draws of each test, thinned evenly to a number.

    Raises:
        TypeError: If tests is no mapping of ArviZ objects.
        ValueError: If there are fewer than two, or one does not fit; with its name.
    """
    if not isinstance(tests, Mapping):
        raise TypeError(
            f"tests: expected {{name: what to_inference_data returns}}, got {tests!r}"
        )
    if len(tests) < 2:
        raise ValueError(f"tests: expected at least two, got {list(tests)}")
    found: dict[str, Drawn] = {}
    for test, idata in tests.items():
        if not isinstance(test, str) or not test or "/" in test:
            raise TypeError(f"tests: expected names without slashes, got {test!r}")
        try:
            own = _read_test(idata, names, number)
        except (TypeError, ValueError) as error:
            raise type(error)(f"tests[{test!r}]: {error}") from None
        first = next(iter(found.values()), own)
        if not np.array_equal(own.bounds, first.bounds):
            raise ValueError(
                f"tests[{test!r}]: its parameters {list(names)} have the bounds "
                f"{own.bounds.tolist()}, but others have {first.bounds.tolist()}; "
                "sample all tests within the same, for the population has but one law"
            )
        found[test] = own
    return found


def _read_test(idata: Any, names: tuple[str, ...], number: int) -> Drawn:
    sampled, chains = samples(idata)
    missing = [name for name in names if name not in sampled]
    if missing:
        raise ValueError(f"it has no parameter {missing}; there are {sampled}")
    stats = dataset(idata, "sample_stats")
    if "log_prior" not in stats or "lp" not in stats:
        raise ValueError(
            "its sample_stats lack lp or log_prior, the densities of each draw; "
            "convert its run with to_inference_data"
        )
    flat = chains.reshape(-1, len(sampled))
    if len(flat) < FEWEST:
        raise ValueError(f"expected at least {FEWEST} draws, got {len(flat)}")
    still = [n for n, ptp in zip(sampled, np.ptp(flat, axis=0), strict=True) if not ptp]
    if still:
        raise ValueError(f"every draw of {still} is the same; run it longer")
    kept = np.linspace(0, len(flat) - 1, min(number, len(flat))).astype(int)
    pooled = [sampled.index(name) for name in names]
    rest = [i for i in range(len(sampled)) if i not in pooled]

    def take(group: Any, name: str) -> Floats:
        values: Floats = group[name].transpose("chain", "draw").values.reshape(-1)
        taken: Floats = values[kept]
        return taken

    log_prior = take(stats, "log_prior")
    if rest:  # theirs stays, and must not be divided out
        by_parameter = _prior_by_parameter(idata)
        log_prior = sum((take(by_parameter, name) for name in names), 0 * log_prior)
    log_rest = take(stats, "lp") - log_prior
    if not np.isfinite(log_rest).all() or not np.isfinite(log_prior).all():
        raise ValueError("lp or log_prior of a draw is not finite")
    constant = dataset(idata, "constant_data").reindex(parameter=list(names))
    return Drawn(
        theta=flat[kept][:, pooled],
        others=flat[kept][:, rest],
        log_prior=log_prior,
        log_rest=log_rest,
        bounds=np.column_stack([constant["lower"].values, constant["upper"].values]),
        prior=np.stack([constant["prior_mean"].values, constant["prior_sd"].values]),
    )


def _prior_by_parameter(idata: Any) -> Any:
    try:
        return dataset(idata, "log_prior")
    except ValueError:
        raise ValueError(
            "it has parameters that are not pooled, and no group log_prior, which "
            "tells their prior from that of the others; convert the run again with "
            "to_inference_data, from a GaussianPrior or IndependentPrior, or pool all"
        ) from None
