"""Tests the type hints and docstrings of all public names, and the stub of the extension module."""

import ast
import inspect
import pathlib

import eyebox
import pytest
from eyebox import _eyebox
from public_names import public


@pytest.mark.parametrize("name", sorted(public()))
def test_all_that_is_public_says_what_it_is(name):
    value = public()[name]
    if not name.endswith("__init__"):
        assert inspect.getdoc(value), "it has a docstring"
    if inspect.isclass(value):
        return
    parameters = [p for p in inspect.signature(value).parameters.values() if p.name not in ("self", "cls")]
    assert "return" in value.__annotations__ and all(p.annotation is not p.empty for p in parameters), "it has type hints"
    # Functions with many parameters list them in the style of NumPy.
    documented = inspect.getdoc(value) or ""
    if len(parameters) > 4 and not name.endswith("__init__"):
        assert "Parameters\n----------\n" in documented
        missing = [p.name for p in parameters if p.name not in documented]
        assert not missing, missing


def stubs():
    """Returns the parameter names of each function of the stub, and of each method as CLASS.METHOD."""
    text = (pathlib.Path(eyebox.__file__).parent / "_eyebox.pyi").read_text(encoding="utf-8")
    found = {}
    for node in ast.parse(text).body:
        inner = [(f"{node.name}.", one) for one in node.body] if isinstance(node, ast.ClassDef) else [("", node)]
        for of, one in inner:
            if isinstance(one, ast.FunctionDef):
                taken = [argument.arg for argument in one.args.args + one.args.kwonlyargs]
                found[of + one.name] = [name for name in taken if name not in ("self", "cls")]
    return found


def test_the_stub_says_what_the_module_has():
    told, has = stubs(), {}
    for name, value in vars(_eyebox).items():
        if inspect.isbuiltin(value):
            has[name] = value
        elif inspect.isclass(value) and not issubclass(value, BaseException):
            has |= {f"{name}.{method}": member for method, member in vars(value).items() if not method.startswith("__")}
            if getattr(value, "__text_signature__", None):
                has[f"{name}.__new__"] = value
    assert not set(told) - {f"{name}.__init__" for name in vars(_eyebox)} - set(has), "the stub has more"
    assert not {name for name in has if not name.startswith("__")} - set(told), "the stub has less"
    for name, taken in told.items():
        try:
            signature = inspect.signature(has[name].__func__ if isinstance(has[name], staticmethod) else has[name])
        except (TypeError, ValueError, KeyError):
            continue  # A property has no signature.
        assert [p for p in signature.parameters if p not in ("self", "cls")] == taken, name
