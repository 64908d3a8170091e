"""Functions and classes as text: their code, and the values that it reads."""

import dis
import hashlib
import importlib.util
import inspect
import pathlib
import sys
import types
from collections.abc import Iterator
from typing import Any, TypeAlias

OWN = {"numpy", "scipy", "emcee", "emcee_femu"}  # whose versions are compared
ASSIGNMENTS = {"STORE_GLOBAL", "STORE_DEREF"}
DESCRIPTORS = (types.MemberDescriptorType, types.GetSetDescriptorType)
HAS_DOCSTRING = 0x4000000  # a flag of code since Python 3.14
Parts: TypeAlias = list[tuple[str, Any]]  # label and part


def qualified(value: Any) -> str:
    """Return module and name of a class or function, with an installed version."""
    module, name = str(value.__module__), value.__qualname__
    if module == "builtins":
        return str(name)
    top = module.partition(".")[0]
    version = getattr(sys.modules.get(top), "__version__", None)
    if version is None or top in OWN or not in_library(value):
        return f"{module}.{name}"
    return f"{module}.{name} ({top} {version})"


def in_library(value: Any) -> bool:
    """Return whether a class, function or module is of Python or of a package."""
    is_module = isinstance(value, types.ModuleType)
    name = str(value.__name__ if is_module else value.__module__)
    top = name.partition(".")[0]
    if top in OWN or top in sys.stdlib_module_names:
        return True
    folders = pathlib.Path(getattr(sys.modules.get(name), "__file__", None) or "").parts
    return "site-packages" in folders or "dist-packages" in folders


def function_parts(function: types.FunctionType) -> tuple[str, Parts]:
    """Return name and code of a function, and the values that the code reads."""
    code = function.__code__
    assigned: set[Any] = set()
    read: dict[Any, None] = {}  # in order
    for instruction in _instructions(code):
        if instruction.opname in ASSIGNMENTS:
            assigned.add(instruction.argval)
        elif instruction.opname == "LOAD_GLOBAL":
            read[instruction.argval] = None
    found: Parts = []
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        if name not in assigned and cell != types.CellType():  # an empty one
            found.append((f"(closure).{name}", cell.cell_contents))
    if in_library(function):
        return f"function {qualified(function)}", found
    keywords = (function.__kwdefaults__ or {}).items()
    for key, value in (*enumerate(function.__defaults__ or ()), *keywords):
        found.append((f"(default)[{key}]", value))
    for name in read:
        if name in assigned or name not in function.__globals__:
            continue
        value = function.__globals__[name]
        if isinstance(value, types.ModuleType):
            found += _module_parts(f"(global).{name}", value, _names(code), set())
        else:
            found.append((f"(global).{name}", value))
    for module in _imported(function):
        label = f"(import).{module.__name__}"
        found += _module_parts(label, module, _names(code), set())
    digest = hashlib.sha256(_text(code).encode()).hexdigest()[:16]
    return f"function {qualified(function)}, code sha256:{digest}", found


def class_parts(cls: type) -> Parts:
    """Return the members of a class and its bases, but those of libraries."""
    found: Parts = [
        (f"(base)[{i}]", base)
        for i, base in enumerate(cls.__bases__)
        if not in_library(base)
    ]
    for name, member in vars(cls).items():
        if isinstance(member, property):
            found += [(f".{name}", f) for f in (member.fget, member.fset) if f]
            continue
        # The function in a class method, static method or cached property.
        member = getattr(member, "__func__", getattr(member, "func", member))
        hidden = name.startswith("__") or name == "_abc_impl"
        if inspect.isfunction(member) or not (
            hidden or isinstance(member, DESCRIPTORS)
        ):
            found.append((f".{name}", member))
    return found


def _names(code: types.CodeType) -> set[str]:
    """Return the names of globals and attributes that code uses."""
    return {name for part in _codes(code) for name in part.co_names}


def _module_parts(
    label: str, module: types.ModuleType, used: set[str], seen: set[str]
) -> Parts:
    """Return what may be used of a module and of the user's modules in it."""
    if in_library(module):
        return [(label, module)]
    if module.__name__ in seen:
        return []
    seen.add(module.__name__)
    found: Parts = []
    for name in sorted(used & vars(module).keys()):
        value = vars(module)[name]
        if isinstance(value, types.ModuleType):
            found += _module_parts(f"{label}.{name}", value, used, seen)
        else:
            found.append((f"{label}.{name}", value))
    return found


def _imported(function: types.FunctionType) -> Iterator[types.ModuleType]:
    """Yield the user's modules that a function imports when it is called.

    They are imported here, as the call would do it: it may be the first.
    """
    found: dict[str, types.ModuleType] = {}
    for part in _codes(function.__code__):
        # A prefix, in long functions, that may stand before any of the three.
        code = [i for i in dis.get_instructions(part) if i.opname != "EXTENDED_ARG"]
        for level, names, instruction in zip(code, code[1:], code[2:], strict=False):
            name = str(instruction.argval)
            if instruction.opname != "IMPORT_NAME" or not (
                level.argval or _is_users(name.partition(".")[0])
            ):
                continue
            try:
                module = __import__(
                    name, function.__globals__, None, names.argval or (), level.argval
                )
            except (Exception, SystemExit):
                continue  # the call itself will say so, or the workers have it
            found[module.__name__] = module
    yield from found.values()


def _is_users(top: str) -> bool:
    return not (top in OWN or top in sys.stdlib_module_names or _installed(top))


def _installed(top: str) -> bool:
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return False
    places = (
        [spec.origin or "", *(spec.submodule_search_locations or ())] if spec else []
    )
    return any(
        folder in pathlib.Path(place).parts
        for place in places
        for folder in ("site-packages", "dist-packages")
    )


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield code and, from its constants, that of the functions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _instructions(code: types.CodeType) -> Iterator[dis.Instruction]:
    for part in _codes(code):
        yield from dis.get_instructions(part)


def _text(constant: Any) -> str:
    """Return code, or a constant of it, as text that is the same in every process."""
    if isinstance(constant, types.CodeType):
        constants = list(constant.co_consts)
        if _documented(constant):
            constants[0] = None
        what = (
            constant.co_code,
            constant.co_exceptiontable,
            constant.co_names,
            constant.co_freevars,
            constant.co_argcount,
            constant.co_kwonlyargcount,
            constant.co_flags,
        )
        return f"{what} {[_text(c) for c in constants]}"
    if isinstance(constant, tuple):
        return f"({[_text(c) for c in constant]})"
    if isinstance(constant, frozenset):  # its order differs between processes
        return f"{{{sorted(map(_text, constant))}}}"
    return repr(constant)


def _documented(code: types.CodeType) -> bool:
    """Return whether the first constant is a docstring."""
    if sys.version_info >= (3, 14):
        return bool(code.co_flags & HAS_DOCSTRING)
    named = not code.co_name.startswith("<")  # as lambdas and comprehensions are
    return named and bool(code.co_consts) and isinstance(code.co_consts[0], str)
