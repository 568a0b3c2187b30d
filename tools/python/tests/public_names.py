"""Finds every public function, class and method of the package."""

import inspect

import eyebox
import eyebox.cluster
import eyebox.slmsuite

MODULES = [eyebox, eyebox.cluster, eyebox.slmsuite]
try:
    import eyebox.live
except ImportError:
    pass  # The system is not Linux.
else:
    MODULES.append(eyebox.live)
try:
    import eyebox.torch
except ImportError:
    pass  # PyTorch is not installed.
else:
    MODULES.append(eyebox.torch)

#: Prefix of modules of the package. Named tuples and exceptions also have methods of Python.
OWN = "eyebox"


def public():
    """Returns every public function, class and method of the package by its name."""
    found = {}
    for module in MODULES:
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isfunction(value) or inspect.isclass(value):
                found[f"{module.__name__}.{name}"] = value
    for name, value in list(found.items()):
        if inspect.isclass(value) and value.__module__.startswith(OWN) and not issubclass(value, BaseException):
            for method, member in vars(value).items():
                member = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
                ours = inspect.isfunction(member) and member.__module__.startswith(OWN)
                if ours and (not method.startswith("_") or method == "__init__") and not issubclass(value, tuple):
                    found[f"{name}.{method}"] = member
    return found
