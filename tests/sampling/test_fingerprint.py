"""fingerprint: what a run depends on, and the difference to another in words."""

import json
import types

import emcee
import numpy as np
import pytest
from test_described_code import of
from test_described_objects import Part, Plain, closure

import emcee_femu as ef
from emcee_femu.sampling.fingerprint import differences, fingerprint

# Every argument of every move of the package, with another value than the default.
SPLITS = {"nsplits": 3, "randomize_split": False, "live_dangerously": True}
MOVES = {
    ef.DEMCMove: ({}, {"sigma": 0.1, "gamma0": 0.5, "mode_jump": 0.1, **SPLITS}),
    ef.SnookerMove: ({}, {"gamma": (1.0, 2.0), **SPLITS}),
    ef.CrossoverMove: ({}, {"pairs": 2, "crossover": [1.0], "sigma": 0.1, **SPLITS}),
    ef.MetropolisMove: ({"cov": [300.0] * 5}, {"cov": [301.0] * 5}),
    ef.IndependenceMove: (
        {
            "weights": [1.0, 1.0],
            "means": np.full((2, 5), 2e3),
            "scale_matrices": np.array([np.eye(5)] * 2) * 1e6,
        },
        {
            "weights": [1.0, 2.0],
            "means": np.full((2, 5), 2001.0),
            "scale_matrices": np.array([np.eye(5)] * 2) * 1.1e6,
            "df": 9.0,
        },
    ),
    ef.TemperedMove: (
        {"inner": ef.DEMCMove(), "betas": [1.0, 0.5]},
        {"inner": ef.SnookerMove(), "betas": [1.0, 0.4]},
    ),
    ef.DelayedAcceptanceMove: (
        {"inner": ef.DEMCMove(), "cheap": ef.paper.mass_spring(1e4).posterior},
        {"inner": ef.DEMCMove(0.1), "cheap": ef.paper.mass_spring(1e5).posterior},
    ),
}
POSTERIOR = ef.paper.mass_spring(1e3).posterior


@pytest.mark.parametrize("move", MOVES, ids=lambda move: move.__name__)
def test_every_setting_of_every_move_is_seen_and_named(move):
    usual, others = MOVES[move]
    before = fingerprint(None, [(move(**usual), 0.5)])
    assert before == fingerprint(None, [(move(**usual), 0.5)])
    assert differences(before, fingerprint(None, [(move(**usual), 0.6)])) == [
        "moves[0][1]: was 0.5, is 0.6"
    ]
    for name, value in others.items():
        lines = differences(
            before, fingerprint(None, [(move(**usual | {name: value}), 0.5)])
        )
        assert lines and all(x.startswith(f"moves[0][0].{name}") for x in lines)


def test_every_move_of_the_package_is_tested_above():
    package = vars(ef.moves).values()
    assert {m for m in package if isinstance(m, type)} == set(MOVES)


@pytest.mark.parametrize(
    "move",
    [
        *(cls(**usual) for cls, (usual, _) in MOVES.items()),
        emcee.moves.DEMove(),
        emcee.moves.DESnookerMove(),
        emcee.moves.StretchMove(),
        emcee.moves.WalkMove(),
        emcee.moves.KDEMove(),
        emcee.moves.GaussianMove(1.0),
    ],
    ids=lambda move: type(move).__name__,
)
def test_what_a_move_counted_or_remembers_does_not_count(move):
    before = fingerprint(POSTERIOR, move)
    sampler = emcee.EnsembleSampler(24, 5, POSTERIOR, moves=move, vectorize=True)
    sampler.run_mcmc(POSTERIOR.start(24, seed=1), 3)
    assert differences(before, fingerprint(POSTERIOR, move)) == []


@pytest.mark.parametrize(
    ("move", "other", "path"),
    [
        (emcee.moves.StretchMove(a=2.0), emcee.moves.StretchMove(a=3.0), "moves.a"),
        (emcee.moves.DEMove(), emcee.moves.DEMove(gamma0=0.3), "moves.gamma0"),
        (
            emcee.moves.GaussianMove(1.0),
            emcee.moves.GaussianMove(2.0),
            "moves.get_proposal.scale",
        ),
        (
            emcee.moves.MHMove(closure(1.0)),
            emcee.moves.MHMove(closure(2.0)),
            "moves.get_proposal(closure).k",
        ),
        (ef.DEMCMove(), [(ef.DEMCMove(), 1.0)], "moves"),
        ("auto", ef.DEMCMove(), "moves"),
    ],
)
def test_moves_of_emcee_are_told_apart(move, other, path):
    lines = differences(fingerprint(None, move), fingerprint(None, other))
    assert [line.partition(":")[0] for line in lines] == [path]


@pytest.mark.parametrize("problem", [ef.paper.mass_spring, ef.paper.h_structure])
def test_the_problems_of_the_paper_go_through_json_and_use_unchanged(problem):
    posterior = problem().posterior
    before = fingerprint(posterior, ef.DEMCMove(), seed=1)
    assert json.loads(json.dumps(before)) == before
    posterior(posterior.start(3, seed=1))
    assert fingerprint(problem().posterior, ef.DEMCMove(), seed=1) == before
    assert fingerprint(posterior, ef.DEMCMove(), seed=1) == before
    lines = differences(
        before, fingerprint(problem(7.0).posterior, ef.DEMCMove(), seed=1)
    )
    assert [x.partition(":")[0] for x in lines] == [
        "terms[0].beta",
        "terms[0]._log_constant",
    ]


def posterior(K=3.0, measured=1.0, sd=1.0, bound=9.0, name="k", terms=1, M=1.0):
    model = ef.MatrixModel([[K]], [[M]], {name: [[1.0]]}, n_modes=1)
    given = [
        ef.FrequencyTerm([measured], relative_sd=0.1, name=f"t{i}")
        for i in range(terms)
    ]
    return ef.LogPosterior(
        model, given, ef.GaussianPrior([name], [1.0], sd, [(0.0, bound)])
    )


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"K": 3.1}, "model._problem.K0"),
        ({"M": 1.1}, "model._problem.M0"),
        ({"measured": 1.1}, "terms[0].measured"),
        ({"sd": 1.1}, "prior.sd"),
        ({"bound": 9.1}, "prior.bounds"),
        ({"name": "m"}, "prior.names"),
        ({"terms": 2}, "terms"),
    ],
)
def test_every_part_of_a_posterior_is_seen_and_named(change, path):
    lines = differences(of_posterior(), of_posterior(**change))
    assert path in [line.partition(":")[0] for line in lines]


def of_posterior(**change):
    return fingerprint(posterior(**change), None)


def test_settings_and_versions_are_seen_and_named():
    stored = fingerprint(POSTERIOR, None, seed=1, nwalkers=16)
    assert stored["emcee version"] == emcee.__version__
    assert stored["numpy version"] == np.__version__
    for name in ("emcee_femu version", "scipy version", "python version"):
        assert stored[name]
    now = stored | {"numpy version": "9.9"}
    del now["nwalkers"]
    assert differences(stored, now) == [
        f"numpy version: was {np.__version__}, is 9.9",
        "nwalkers: was 16, is absent",
    ]


def test_the_numbers_that_changed_are_counted():
    one, other = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.5, 3.5])
    assert differences(of(one), of(other)) == [
        "value: 2 of 3 changed, was float64 (3,): 1.0, 2.0, 3.0, "
        "is float64 (3,): 1.0, 2.5, 3.5"
    ]


def test_the_parts_of_a_replaced_object_are_not_listed():
    lines = differences(of(Part(1.0, Plain(a=1))), of(types.SimpleNamespace(E=2.0)))
    assert len(lines) == 1
    assert "was test_described_objects.Part, is types.SimpleNamespace" in lines[0]
    # A name that only begins alike is another path.
    assert len(differences({"a": "1", "ab": "1"}, {"a": "2", "ab": "2"})) == 2
