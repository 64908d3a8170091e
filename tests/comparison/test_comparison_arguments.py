import pytest
from test_comparison import NAMES, linear

import emcee_femu as ef
from emcee_femu.comparison.ranking import known_moments

ONE = {"DE-MC": ef.DEMCMove()}


@pytest.mark.parametrize(
    ("error", "message", "changes"),
    [
        (TypeError, "posterior: expected a LogPosterior", {"posterior": len}),
        (TypeError, "moves: expected moves by label", {"moves": ef.DEMCMove()}),
        (TypeError, "moves: expected moves by label", {"moves": {}}),
        (
            TypeError,
            r"moves\['x'\]: expected an emcee",
            {"moves": {**ONE, "x": "demc"}},
        ),
        (TypeError, r"moves\['x'\]: expected an emcee", {"moves": {"x": [(2, 0.5)]}}),
        (
            ValueError,
            "nsplits: expected at most",
            {"moves": {"x": ef.DEMCMove(nsplits=9)}},
        ),
        (
            ValueError,
            "sd: ",
            {"moves": {**ONE, "x": [ef.MetropolisMove(sd=[1.0, 2.0])]}},
        ),
        (TypeError, "exactly one of the two", {"nsteps": None}),
        (TypeError, "exactly one of the two", {"max_evaluations": 10_000}),
        (TypeError, "nsteps: expected a whole", {"nsteps": 1e4}),
        (ValueError, "at least 8 steps to judge, got 7 of 9", {"nsteps": 9}),
        (
            ValueError,
            "max_eval.*at least 128",
            {"nsteps": None, "max_evaluations": 127},
        ),
        (ValueError, "ensembles: expected at least 2", {"ensembles": 1}),
        (ValueError, "discard: expected the fraction", {"discard": 500}),
        (ValueError, "discard: expected at least 0", {"discard": -0.1}),
        (TypeError, "seed: expected a whole", {"seed": None}),
        (ValueError, r"reference: .*\['z'\]", {"reference": {"z": (1, 2)}}),
        (ValueError, "reference: .*got none", {"reference": {}}),
        (ValueError, r"reference \(its sd\)", {"reference": {"a": (1, 0)}}),
        (ValueError, r"reference: .*got \[\[", {"reference": {"a": (1, 2, 3)}}),
    ],
)
def test_wrong_arguments_are_refused_before_sampling(error, message, changes):
    posterior = linear()
    arguments = {"posterior": posterior, "moves": ONE, "nwalkers": 8, "nsteps": 20}
    arguments |= {"ensembles": 2, "seed": 1}
    with pytest.raises(error, match=message):
        ef.compare_moves(**{**arguments, **changes})
    assert posterior.model.rows == 0


def test_the_reference_is_taken_by_name():
    known = known_moments({"c": (1.0, 2.0), "a": (3.0, 4.0)}, NAMES)
    assert known.columns.tolist() == [2, 0]
    assert known.mean.tolist() == [1.0, 3.0] and known.sd.tolist() == [2.0, 4.0]
