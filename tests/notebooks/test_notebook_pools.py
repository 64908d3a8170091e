"""The button that interrupts a notebook, with pools of every start method."""

import pytest
from support.notebooks import MODEL, assert_quiet, execute
from support.systems import need_start_method, posix

pytestmark = pytest.mark.slow  # the law that no process is left; a kernel for each
every_method = pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])


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
