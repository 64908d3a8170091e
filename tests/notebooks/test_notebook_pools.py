"""Pools of every start method in a notebook, and the button that interrupts it."""

import pytest
from support.notebooks import MODEL, assert_quiet, execute
from support.systems import need_start_method, posix

pytestmark = pytest.mark.slow
# Forked workers inherit functions, and those of a fork server are sent them as these.
spawned = pytest.mark.parametrize("method", ["spawn"])
every_method = pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])


@spawned
def test_every_sampler_has_the_models_of_a_notebook_on_its_workers(tmp_path, method):
    need_start_method(method)
    cells = {
        "model": MODEL,
        "method": f"multiprocessing.set_start_method({method!r})",
        "samplers": """
posterior = posteriors["lambda"]
runs = {workers: ef.run(posterior, steps=20, ensembles=1, seed=1, workers=workers)
        for workers in (None, 2)}
a, b = (run[0].get_chain() for run in runs.values())
print((a == b).all())
a, b = (ef.find_map(posterior, seed=1, workers=n).table for n in (None, 2))
print(a == b)
a, b = (ef.anneal(posterior, 100, seed=1, workers=n).theta for n in (None, 2))
print((a == b).all())
a, b = (ef.emulate(posterior, 12, seed=1, workers=n) for n in (None, 2))
print(str(a) == str(b))
found = ef.run(a.posterior, steps=500, seed=1, moves=ef.DEMCMove(), ensembles=1)
idata = ef.to_inference_data(found, discard=100)
a, b = (ef.certify(idata, posterior, 20, seed=1, workers=n) for n in (None, 2))
print((a.weights == b.weights).all(), children())
""",
        "pool": """
from concurrent.futures import ProcessPoolExecutor
executor = ProcessPoolExecutor(2)
print(same(pool=executor), same(pool=ef.EvaluationPool(executor)))
""",
        "again": """
def function(p):  # the model was improved, and the pool is still that of before
    return 1.1 * shear(p["k1"], p["k2"])

improved = posterior_of(ef.FunctionModel(function))
new = chain(improved, pool=executor)
print((new == chain(improved)).all(), (new == serial["function"]).all())
executor.shutdown()
""",
    }
    shown = execute(cells, tmp_path)
    assert_quiet(shown)
    assert shown["samplers"].stdout == "True\nTrue\nTrue\nTrue\nTrue []\n"
    assert shown["pool"].stdout == "[True, True, True] [True, True, True]\n"
    assert shown["again"].stdout == "True False\n"


@posix
@every_method
def test_after_the_interrupt_the_kernel_works_and_no_process_is_left(tmp_path, method):
    need_start_method(method)
    cells = {
        "model": MODEL,
        "stuck": f"""
import signal, threading
from pathlib import Path
multiprocessing.set_start_method({method!r})

def stuck(p):
    if not Path("first").exists():  # the prior mean, which is solved alone
        open("first", "w").close()
        return shear(p["k1"], p["k2"])
    open(f"begun {{os.getpid()}}", "w").close()
    time.sleep(1000)

def press():  # as the button does, once both are at work
    while len([*Path().glob("begun *")]) < 2:
        time.sleep(0.1)
    os.killpg(os.getpgid(0), signal.SIGINT)

threading.Thread(target=press, daemon=True).start()
try:
    ef.run(posterior_of(ef.FunctionModel(stuck)), workers=2, ensembles=1, **size)
except KeyboardInterrupt as error:
    print("again" if isinstance(error.__context__, KeyboardInterrupt) else "once")
""",
        "after": """
begun = [int(file.name.split()[1]) for file in Path().glob("begun *")]
gone = []
for pid in begun:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        gone.append(pid)
print(len(begun), gone == begun, children(), same(workers=2))
""",
    }
    shown = execute(cells, tmp_path)
    assert_quiet(shown)
    assert shown["stuck"].stdout == "once\n"
    assert shown["after"].stdout == "2 True [] [True, True, True]\n"
