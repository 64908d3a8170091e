"""What is kept of solves that fail."""

from emcee_femu.evaluation.failures import Failure, FailureLog


def test_a_log_prints_how_many_failed_why_and_one_of_them():
    log = FailureLog(0.5)
    assert "0 of 0" in str(log)
    late = Failure("time-out", "TimeoutExpired: 600 s", {"k1": 2.5})
    broken = Failure("exception", "OSError: no licence", {"k1": 1.5})
    log.count(1_200, [late, broken, broken])
    said = str(log)
    assert "3 of 1,200" in said and "1 time-out" in said and "2 exception" in said
    assert "600 s" in said and "2.5" in said and "no licence" not in said
    again = FailureLog(0.5)  # of a run that goes on, which keeps no failures
    again.restore(log.counts)
    assert "3 of 1,200" in str(again)
