"""The runs that an ArviZ object holds, as samplers are read."""

import json
from collections import Counter
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..interfaces import Floats
from .arviz_objects import dataset, samples


@dataclass(frozen=True, eq=False)
class StoredRun:
    """One ensemble of "auto", with its proposal.

    Attributes:
        chain: ``(steps, walkers, d)``.
        log_prob: ``(steps, walkers)``.
        recipe: What "auto" recorded, as its ``record``.
        failures: Of all ensembles, as ``causes``.
    """

    chain: Floats
    log_prob: Floats
    recipe: Any
    failures: Any

    @property
    def iteration(self) -> int:
        """The number of steps."""
        return len(self.chain)

    def get_chain(self, discard: int = 0, thin: int = 1) -> Floats:
        """Return the steps that are left, as emcee does."""
        return self.chain[discard + thin - 1 :: thin]

    def get_log_prob(self, discard: int = 0, thin: int = 1) -> Floats:
        """Return their log-posteriors."""
        return self.log_prob[discard + thin - 1 :: thin]


def read_runs(idata: Any) -> list[StoredRun]:
    """Return the ensembles of "auto" in what :func:`to_inference_data` returned.

    Raises:
        TypeError: If idata is something else.
        ValueError: If it is of a run of other moves.
    """
    posterior = dataset(idata, "posterior")
    record = json.loads(str(posterior.attrs.get("recipe", "null")))
    if record is None:
        if posterior.attrs.get("population"):
            what, remedy = "an annealed population", "the population itself"
        elif posterior.attrs.get("tempered"):
            what, remedy = "the cold walkers of a tempered run", "its samplers or file"
        else:
            what, remedy = "a run of other moves than 'auto'", "a run of 'auto'"
        raise ValueError(
            f"samplers: expected an ArviZ object of a run of 'auto', got {what}, from "
            f"which no evidence can be had; give {remedy}"
        )
    _, draws = samples(idata)  # (chains, draws, d)
    log_prob = dataset(idata, "sample_stats")["lp"].transpose("chain", "draw").values
    ensembles = posterior["ensemble"].values
    failures = SimpleNamespace(
        causes=Counter(json.loads(str(posterior.attrs.get("failures", "{}"))))
    )
    return [
        StoredRun(
            np.swapaxes(draws[ensembles == ensemble], 0, 1),
            log_prob[ensembles == ensemble].T,
            SimpleNamespace(record=record),
            failures,
        )
        for ensemble in np.unique(ensembles)
    ]
