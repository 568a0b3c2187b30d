"""Makes calls of every public function of the package, with usual arguments and with any others."""

import inspect
import random
import re
import typing

import eyebox
import eyebox._settings
import numpy as np
from public_names import public

SIDE = 8
NUMBERS = [0, -0.0, 1e-3, -2e-3, 4e-3, 1, -1, 1e9, 1e300, -1e300, 1e-300, float("nan"), float("inf"), 10**30, True]
TEXTS = ["", "tiny.toml", "builtin:plane", "builtin:nothing", "/", "/dev/null", "nowhere.zarr", "cpu", "CPU", "\0", "\udcff", "é" * 99]
TEXTS += ["1mm", "0.5D", "-2 mm", "1e999mm", "4", "1kg", "nan", "random:1", "paper:"]
OTHERS = [None, [], {}, (), object(), b"bytes", {"a": 1}, [[1.0], [1, 2]], lambda *_: None, range(3), {1, 2}, 3j, int]
ARRAYS = [
    np.zeros((SIDE, SIDE)),
    np.zeros((2, 2, SIDE, SIDE)),
    np.full((SIDE, SIDE), np.nan),
    np.full((SIDE, SIDE, 3), -1.0),
    np.zeros((2, 0, 3)),
    np.zeros(()),
    np.zeros((1,) * 8),
    np.zeros((SIDE, SIDE), complex),
    np.zeros((SIDE, SIDE), "S3"),
    np.zeros((SIDE, SIDE), "M8[s]"),
    np.zeros((SIDE, SIDE), [("a", "f4")]),
    np.zeros((SIDE, SIDE), object),
    np.broadcast_to(np.float32(1), (2, 2, SIDE, SIDE)),
    np.broadcast_to(np.float32(1), (1, 1, 1 << 20, 1 << 20)),
    np.zeros((1, SIDE, SIDE), np.float16),
    np.zeros((SIDE, 2 * SIDE))[:, ::-2],
    np.ma.masked_all((SIDE, SIDE)),
    np.zeros((SIDE, SIDE), np.uint8),
    np.zeros((SIDE, SIDE), ">u2"),
    np.asfortranarray(np.ones((3, 3, SIDE, SIDE))),
]
#: Functions that end or empty the object of the call, and are called with another object.
ENDING = {"eyebox.Session.stop", "eyebox.live.Live.close"}
#: Arguments that are a time to wait or a number of repetitions. A large number would be a long wait, as it should be.
WAITS = {"timeout", "sets", "loop", "wait.seconds", "play.seconds", "play.rate"}
#: Arguments that are always given, because the default is large: 2 million pixels, or 40 pictures.
ALWAYS = {"display", "size", "seconds", "clock", "client", "most", "frames", "steps", "pupils", "picture", "passes"}
SETTINGS = re.compile(r"Unpack\[(\w+)\]")


class NoUsualValue(Exception):
    """An argument for which a test has no usual value."""


class Calls:
    """The calls of all public functions, from one generator of random numbers.

    Methods are called on ``objects``, by the name of their class. The keys of ``usual`` are names of arguments, alone or
    after the name of the function.
    """

    def __init__(self, rng: random.Random, objects: dict, usual: dict) -> None:
        self.rng, self.objects, self.usual = rng, objects, usual
        self.names = [name for name, value in sorted(public().items()) if not inspect.isclass(value)]
        self.functions = public()

    def whatever(self, parameter=""):
        """Returns any value at all."""
        kinds = [TEXTS, OTHERS, ARRAYS, [one for some in self.objects.values() for one in some]]
        return self.rng.choice(self.rng.choice(kinds if parameter in WAITS else [NUMBERS, NUMBERS, *kinds]))

    def choices(self, name, parameter):
        """Returns usual values of an argument."""
        short = f"{name.split('.')[-1]}.{parameter.name}"
        for key in (f"{name}.{parameter.name}", short, parameter.name):
            if key in self.usual:
                return self.usual[key]
        literals = re.findall(r"'([\w-]+)'", str(parameter.annotation)) if "Literal" in str(parameter.annotation) else []
        if literals:
            return literals
        if "bool" in str(parameter.annotation):
            return [False, True]
        raise NoUsualValue(f"{name} has the argument {parameter.name}")

    def value(self, name, parameter):
        waits = parameter.name in WAITS or f"{name.split('.')[-1]}.{parameter.name}" in WAITS
        if self.rng.random() < 0.75:
            return self.rng.choice(self.choices(name, parameter))
        value = self.whatever(next(iter(WAITS)) if waits else "")
        return self.rng.choice(self.choices(name, parameter)) if value is None and parameter.name in ALWAYS else value

    def settings(self, kind):
        """Returns a few settings of a solve or a refinement, usual ones or any others."""
        fields = getattr(eyebox._settings, kind).__annotations__
        given = {}
        for key in self.rng.sample(sorted(fields), self.rng.randrange(2)):
            annotation = fields[key].__forward_arg__ if isinstance(fields[key], typing.ForwardRef) else fields[key]
            parameter = inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, annotation=annotation)
            try:
                given[key] = self.value("settings", parameter)
            except NoUsualValue:
                given[key] = self.whatever()
        return given

    def arguments(self, name, function):
        """Returns the arguments of a call by their names."""
        if name == "eyebox.SolveSettings.__init__":
            return self.settings("AllFields")
        given = {}
        for parameter in inspect.signature(function).parameters.values():
            kind = SETTINGS.search(str(parameter.annotation))
            if kind and kind[1] != "DisplayFields":
                given |= self.settings(kind[1])
            elif parameter.name in ("self", "cls") or parameter.kind is parameter.VAR_POSITIONAL:
                continue
            elif parameter.kind is parameter.VAR_KEYWORD:
                given |= {"levels": self.whatever()} if self.rng.random() < 0.2 else {}
            elif parameter.default is parameter.empty or parameter.name in ALWAYS or self.rng.random() < 0.4:
                given[parameter.name] = self.value(name, parameter)
        odd = self.rng.random()
        if odd < 0.03:
            given["nothing"] = self.whatever()
        elif odd < 0.06 and given and next(iter(given)) not in ALWAYS:
            del given[next(iter(given))]
        return given

    def call(self, name):
        """Calls a function once, and returns its result."""
        function = self.functions[name]
        of, _, short = name.rpartition(".")
        if name == "eyebox.command":
            return eyebox.command(*self.rng.choice([["display", "list"], [self.whatever()], ["info", self.whatever()], []]))
        given = self.arguments(name, function)
        positional = [self.whatever() for _ in range(9)] if self.rng.random() < 0.02 else []
        if short == "__init__":
            return self.functions[of](*positional, **given)
        if not inspect.isclass(self.functions.get(of)):
            return function(*positional, **given)
        if inspect.ismethod(getattr(self.functions[of], short)):
            return getattr(self.functions[of], short)(*positional, **given)
        there = self.rng.choice(self.objects[f"ended {of}"] if name in ENDING else self.objects[of])
        member = getattr(there, short)
        return member(*positional, **given) if callable(member) else member
