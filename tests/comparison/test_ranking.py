from types import SimpleNamespace

import numpy as np
import pytest

from emcee_femu.extensions.comparison.compare import Entry, conclude


def entry(
    label, efficiency, error=1.0, short="converged", before=0, recipe="", kept=10_000
):
    """Return an entry of four ensembles with the given numbers."""
    bulk = np.array([efficiency * kept / 1000, 1e9])
    chains, good = SimpleNamespace(short=short), short == "converged"
    diagnosis = SimpleNamespace(chains=chains, converged=good, ess_bulk=bulk)
    # Deviations of which the standard error of the mean is `error`.
    around = efficiency + error * np.sqrt(3) * np.array([1, -1, 1, -1])
    ess = around * kept / 4 / 1000
    search = SimpleNamespace(sentence=recipe) if recipe else None
    run = SimpleNamespace(evaluations=before, search=search)
    return Entry(label, diagnosis, ess, kept, 12_500, 2.0, run, None)


@pytest.mark.parametrize(("lead", "wins"), [(9.9, False), (10.1, True)])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_lead_counts_from_two_combined_standard_errors(lead, wins, backwards):
    entries = [entry("A", 50 + lead, 3.0), entry("B", 50, 4.0), entry("C", 10)]
    winner, words = conclude(entries[::-1] if backwards else entries)
    assert winner == ("A" if wins else None)
    first = f"A {50 + lead:.3g} +- 3"
    if wins:
        assert (
            words == f"Winner: {first} ESS per 1000 evaluations; the next is B 50 +- 4."
        )
    else:
        assert words == (
            f"No winner: {first} and B 50 +- 4 are within the spread of the ensembles "
            "(ESS per 1000 evaluations)."
        )


def test_a_move_that_has_not_converged_cannot_win():
    fast = entry("fast", 900, short="too short: 30 tau")
    winner, words = conclude([fast, entry("A", 60), entry("B", 50)])
    assert winner == "A"
    assert words.splitlines()[1] == (
        "Not converged, so excluded: fast (too short: 30 tau)."
    )
    winner, words = conclude([fast, entry("A", 60)])
    assert winner == "A" and "; no other has converged." in words
    winner, words = conclude([fast, entry("slow", 1, short="too short: 30 tau")])
    assert winner is None and words == "No winner: no move has converged; run longer."


def test_burn_in_may_turn_the_order_and_that_is_said():
    auto = entry("auto", 100, before=50_000, recipe="It burnt in")
    winner, words = conclude([entry("A", 60), auto])
    assert winner == "auto"
    assert words.splitlines()[1:] == [
        "End to end, with burn-in counted, A is ahead: 48 against 16 of auto.",
        "auto: It burnt in; 50000 evaluations in all before its chains.",
    ]
