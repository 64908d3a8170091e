"""A solver in modules of the user's: no change of them escapes the fingerprint."""

import importlib
import sys

import pytest
from test_described_code import compiled, of

import emcee_femu as ef
from emcee_femu.sampling.fingerprint import differences

SOLVE = "def solve(p): return [{} * p['k']]\n"
ONE, OTHER = SOLVE.format(1.0), SOLVE.format(1.1)
# A long function: its names and constants need a prefix in the byte code.
LONG = "".join(f"    p.name{i}, {i}.5\n" for i in range(300))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to import from; what was imported from it is forgotten afterwards."""
    # Byte code is told by its second and size, which a change here may not alter.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    forget(tmp_path)


def forget(folder):
    for name, module in [*sys.modules.items()]:
        if str(folder) in str(getattr(module, "__spec__", None)):
            del sys.modules[name]
    importlib.invalidate_caches()


def described(folder, files):
    """Write files and return the fingerprint of ``users_main.solve``, as if anew."""
    for name, text in files.items():
        place = folder / name
        place.parent.mkdir(exist_ok=True)
        place.write_text(text)
    forget(folder)
    return of(importlib.import_module("users_main").solve)


PACKAGE = {"users_package/__init__.py": "", "users_package/sub.py": ONE}
CHANGED = {"users_package/sub.py": OTHER}
WAYS = {
    "a submodule, imported above": (
        "import users_package.sub\ndef solve(p): return users_package.sub.solve(p)",
        PACKAGE,
        CHANGED,
    ),
    "a submodule by another name": (
        "import users_package.sub as s\ndef solve(p): return s.solve(p)",
        PACKAGE,
        CHANGED,
    ),
    "a module": (
        "import users_module\ndef solve(p): return users_module.solve(p)",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a function, imported inside": (
        "def solve(p):\n    from users_module import solve\n    return solve(p)",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a function by another name, imported inside": (
        "def solve(p):\n    from users_module import solve as s\n    return s(p)",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a module, imported inside": (
        "def solve(p):\n    import users_module\n    return users_module.solve(p)",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a module, imported in a function inside": (
        "def solve(p):\n    def inner():\n        import users_module\n"
        "        return users_module.solve(p)\n    return inner()",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a module, imported inside a long function": (
        f"def solve(p):\n{LONG}    import users_module as m\n    return m.solve(p)",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
    "a submodule, imported inside": (
        "def solve(p):\n    import users_package.sub\n"
        "    return users_package.sub.solve(p)",
        PACKAGE,
        CHANGED,
    ),
    "a submodule by another name, imported inside": (
        "def solve(p):\n    import users_package.sub as s\n    return s.solve(p)",
        PACKAGE,
        CHANGED,
    ),
    "a submodule from its package, imported inside": (
        "def solve(p):\n    from users_package import sub\n    return sub.solve(p)",
        PACKAGE,
        CHANGED,
    ),
    "a submodule from where the function is, imported inside": (
        "from users_package.own import solve",
        {
            "users_package/own.py": "def solve(p):\n    from . import sub\n"
            "    return sub.solve(p)",
            **PACKAGE,
        },
        CHANGED,
    ),
    "a function from where the function is, imported inside": (
        "from users_package.own import solve",
        {
            "users_package/own.py": "def solve(p):\n    from .sub import solve\n"
            "    return solve(p)",
            **PACKAGE,
        },
        CHANGED,
    ),
    "a module of a module, both imported inside": (
        "def solve(p):\n    import users_module\n    return users_module.through(p)",
        {
            "users_module.py": "def through(p):\n    from users_package.sub import "
            "solve\n    return solve(p)",
            **PACKAGE,
        },
        CHANGED,
    ),
    "a number of a submodule": (
        "import users_package.sub\ndef solve(p): return users_package.sub.K * p['k']",
        {"users_package/__init__.py": "", "users_package/sub.py": "K = 1.0"},
        {"users_package/sub.py": "K = 1.1"},
    ),
    "a method of an object": (
        "class Solver:\n    def __call__(self, p):\n        import users_module\n"
        "        return users_module.solve(p)\nsolve = Solver()",
        {"users_module.py": ONE},
        {"users_module.py": OTHER},
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_change_of_an_imported_file_is_seen_and_named(folder, way):
    main, files, change = WAYS[way]
    before = described(folder, {"users_main.py": main, **files})
    assert described(folder, {}) == before  # imported anew, but the same
    lines = differences(before, described(folder, change))
    assert lines and all("solve" in line or ".K: was" in line for line in lines)
    harmless = {name: f"# {text!r}\n\n{text}" for name, text in files.items()}
    assert described(folder, harmless) == before


def test_what_the_call_imported_first_makes_no_difference(folder):
    for main, files, _ in WAYS.values():
        before = described(folder, {"users_main.py": main, **files})
        solve = sys.modules["users_main"].solve
        if LONG not in main:  # which is made of names alone
            solve({"k": 1.0})
        assert of(solve) == before


def test_another_function_of_an_imported_file_does_not_count(folder):
    main, files, _ = WAYS["a module, imported inside"]
    before = described(folder, {"users_main.py": main, **files})
    more = {"users_module.py": ONE + "def other(p): return 2.0\nunused = 3\n"}
    assert described(folder, more) == before


def test_two_modules_that_import_each_other_come_to_an_end(folder):
    files = {
        "users_main.py": "import users_one\n"
        "def solve(p): return users_one.users_two.users_one.solve(p)",
        "users_one.py": "import users_two\n" + ONE,
        "users_two.py": "import users_one\n",
    }
    before = described(folder, files)
    (line,) = differences(
        before, described(folder, {"users_one.py": "import users_two\n" + OTHER})
    )
    assert line.startswith("value(global).users_one.solve: was function")


def test_libraries_that_are_imported_inside_are_not_described(folder, monkeypatch):
    plain = "def solve(p): return p['k']\n"
    before = described(folder, {"users_main.py": plain})
    vendor = folder / "site-packages"
    monkeypatch.syspath_prepend(vendor)
    source = (
        "def solve(p):\n    import json, xml.dom, numpy.linalg, emcee_femu, vendor\n"
        "    from scipy import optimize\n    from vendors import sub\n"
        "    json.dumps(vendor.K)\n    return p['k']\n"
    )
    files = {
        "users_main.py": source,
        "site-packages/vendor.py": "K = 1",
        "site-packages/vendors/__init__.py": "",
        "site-packages/vendors/sub.py": "",
    }
    (vendor / "vendors").mkdir(parents=True)
    now = described(folder, files)
    assert now.keys() == before.keys()  # no more than the function itself
    assert not {"vendor", "vendors"} & sys.modules.keys()  # nor was it imported
    assert described(folder, {"site-packages/vendor.py": "K = 2"}) == now


BROKEN = {
    "is not there": None,
    "misses a library": "import no_such_library_of_anyone",
    "does not parse": "def solve(p) return",
    "ends the program": "raise SystemExit('no licence')",
    "ends the program by sys.exit": "import sys\nsys.exit()",
    "fails": "1 / 0",
}


@pytest.mark.parametrize("fault", BROKEN)
@pytest.mark.parametrize(
    "statement",
    ["import users_broken", "from users_broken import x", "import users_broken.y as x"],
)
def test_an_import_that_fails_is_left_to_the_call(folder, fault, statement):
    source = (
        f"def solve(p):\n    {statement}\n    import users_module\n"
        "    return users_module.solve(p)"
    )
    files = {"users_main.py": source, "users_module.py": ONE}
    if BROKEN[fault] is not None:
        files["users_broken.py"] = BROKEN[fault]
    before = described(folder, files)
    assert described(folder, {}) == before
    # What can be imported is followed all the same.
    (line,) = differences(before, described(folder, {"users_module.py": OTHER}))
    assert line.startswith("value(import).users_module.solve: was function")


@pytest.mark.parametrize("package", [None, "", "users_package"])
def test_a_relative_import_that_leads_nowhere_is_left_to_the_call(package):
    source = "def f(p):\n    from ... import above\n    return above.solve(p)"
    assert of(compiled(source, __package__=package))["value"].startswith("function")


def test_a_keyboard_interrupt_at_import_is_not_swallowed(folder):
    source = "def solve(p):\n    import users_broken\n"
    with pytest.raises(KeyboardInterrupt):
        described(
            folder,
            {"users_main.py": source, "users_broken.py": "raise KeyboardInterrupt"},
        )


def test_importing_for_the_fingerprint_hides_nothing_of_a_package(folder):
    # The package has a function and a file of one name; the call takes the function.
    files = {
        "users_main.py": "def solve(p):\n    from users_package import sub\n"
        "    return sub(p)",
        "users_package/__init__.py": ONE.replace("solve", "sub"),
        "users_package/sub.py": OTHER,
    }
    described(folder, files)
    assert sys.modules["users_main"].solve({"k": 1.0}) == [1.0]


def test_a_run_is_not_resumed_with_another_imported_solver(folder):
    pytest.importorskip("h5py", reason="h5py is not installed")
    main, files, change = WAYS["a submodule, imported inside"]
    described(folder, {"users_main.py": main, **files})

    def go(nsteps):
        model = ef.FunctionModel(importlib.import_module("users_main").solve)
        posterior = ef.LogPosterior(
            model,
            ef.FrequencyTerm([1.0], relative_sd=0.1),
            ef.GaussianPrior(["k"], [1.0], [0.1], bounds=[(0.5, 2.0)]),
        )
        file = folder / "run.h5"
        return ef.run(posterior, nsteps=nsteps, seed=1, backend=file, resume=True)

    go(2)
    described(folder, {})
    (sampler,) = go(4)
    assert sampler.iteration == 4
    described(folder, change)
    with pytest.raises(ValueError, match=r"users_package\.sub\.solve: was function"):
        go(6)
