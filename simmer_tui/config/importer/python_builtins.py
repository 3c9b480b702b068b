"""Functions and methods of Python, `math`, `numpy` and `pygame` for a foreign file, within bounds."""

import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from simmer_tui.config.importer.python_values import (
    MAX_ITEMS,
    Located,
    Vector,
    as_key,
    as_text,
    bounded,
    checked,
    formatted,
    item_of,
    items_of,
    readable,
    truth,
)
from simmer_tui.errors import NotUnderstoodError

# Functions of `math` and `numpy`, of numbers only.
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in ("cos", "sin", "tan", "acos", "asin", "atan", "atan2", "sqrt")},
    **{name: getattr(math, name) for name in ("radians", "degrees", "hypot", "floor", "ceil", "fabs", "exp")},
    "deg2rad": math.radians,
    "rad2deg": math.degrees,
    "arctan2": math.atan2,
    "arctan": math.atan,
    "pow": math.pow,
}
# Functions of Python, of numbers and lists of numbers only.
_BUILTINS: Mapping[str, Callable[..., Any]] = {item.__name__: item for item in (abs, round, min, max, sum)}
MODULE_CONSTANTS: Mapping[str, Any] = {
    f"{module}.{name}": value
    for module in ("math", "numpy")
    for name, value in (("pi", math.pi), ("tau", math.tau), ("e", math.e), ("inf", math.inf))
}
"""The constants of modules, by full name."""


def numbers_only(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """The arguments, if they are numbers and lists of numbers. Raises NotUnderstoodError."""
    for argument in arguments:
        items = argument if isinstance(argument, list) else [argument]
        if not all(isinstance(item, int | float) for item in items):
            raise NotUnderstoodError("a function is understood with numbers only")
    return arguments


def _numeric(function: Callable[..., Any], *arguments: Any) -> Any:
    return checked(function, *numbers_only(arguments))


def _range(*arguments: Any) -> list[int]:
    if not all(isinstance(each, int) for each in arguments):
        raise NotUnderstoodError("a range is understood of whole numbers only")
    return list(checked(range, *arguments))


def _parsed(kind: type[float | int], *arguments: Any) -> Any:
    if len(arguments) > 1 or not all(isinstance(each, int | float | str) for each in arguments):
        raise NotUnderstoodError("a function is understood with numbers only")
    # Python reads at most some thousand digits.
    return checked(kind, *(each[:100] if isinstance(each, str) else each for each in arguments))


def table(given: Any = None, /, **more: Any) -> dict[Any, Located]:
    """A dict of another dict or of pairs, and of keywords, whose values are located."""
    made: dict[Any, Located] = {}
    if isinstance(given, dict):
        made.update(given)
    elif given is not None:
        for pair in items_of(given):
            if not isinstance(pair, list) or len(pair) != 2:
                raise NotUnderstoodError("a dict is understood of another or of pairs only")
            made[as_key(pair[0])] = Located(pair[1], 0)
    made.update(more)
    return made


def _sorted(items: Any, *, reverse: Any = False) -> list[Any]:
    values = items_of(items)
    numbers = all(isinstance(each, int | float) for each in values)
    if not numbers and not all(isinstance(each, str) for each in values):
        raise NotUnderstoodError("only numbers or texts are sorted")
    return sorted(values, reverse=truth(reverse))


def _vector(*arguments: Any) -> Any:
    """The `Vector2` of two numbers; of other arguments, just a list."""
    numbers = arguments[0] if len(arguments) == 1 else list(arguments)
    if isinstance(numbers, list) and len(numbers) == 2 and all(isinstance(n, int | float) for n in numbers):
        return Vector(numbers)
    # The later use of the list reports the mistake.
    return numbers


def _spaced(start: float, step: float, count: Any) -> list[float]:
    if not isinstance(count, int) or not 0 <= count <= MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    return [start + step * i for i in range(count)]


def _linspace(start: Any, stop: Any, /, num: Any = 50, *, endpoint: Any = True) -> list[float]:
    """The numbers of `linspace`; 50 is numpy's default count."""
    numbers_only((start, stop, num))
    # A single number is the start, without a step to divide by.
    return _spaced(start, (stop - start) / max(num - 1 if endpoint else num, 1), num)


def _arange(start: Any, stop: Any = None, step: Any = 1, /) -> list[float]:
    start, stop = (0, start) if stop is None else (start, stop)
    numbers_only((start, stop, step))
    return _spaced(start, step, max(0, checked(lambda: math.ceil((stop - start) / step))))


NAMES_OF_MATH = (*_FUNCTIONS, "pi", "tau", "e", "inf")
"""The names that `from math import *` gives."""
CALLS: Mapping[str, Callable[..., Any]] = {
    **{f"math.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{f"numpy.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{name: partial(_numeric, function) for name, function in _BUILTINS.items()},
    **dict.fromkeys(("list", "tuple", "numpy.array", "numpy.asarray"), lambda items=(): items_of(items)),
    **{kind.__name__: partial(_parsed, kind) for kind in (float, int)},
    "bool": lambda value=False: truth(value),
    "str": lambda value="": as_text(value),
    "range": _range,
    "len": lambda items: len(items_of(items)),
    "enumerate": lambda items, start=0: [[start + n, each] for n, each in enumerate(items_of(items))],
    "zip": lambda *lists, strict=False: [list(row) for row in zip(*map(items_of, lists), strict=False)],
    "reversed": lambda items: items_of(items)[::-1],
    "sorted": _sorted,
    "any": lambda items: any(map(truth, items_of(items))),
    "all": lambda items: all(map(truth, items_of(items))),
    "numpy.linspace": _linspace,
    "numpy.arange": _arange,
    "Vector2": _vector,
}
"""The functions that are called, by full name."""
OF_SCREEN = frozenset({"print", "logging.info", "logging.debug", "logging.warning", "warnings.warn"})
"""Functions without an effect on values."""


def called(name: str, arguments: tuple[Any, ...], keywords: Mapping[str, Any]) -> Any:
    """The result of one of `CALLS`. Raises NotUnderstoodError."""
    try:
        return bounded(CALLS[name](*arguments, **keywords))
    except TypeError:
        raise NotUnderstoodError(f"{name} is not understood with these arguments") from None


# -- methods ---------------------------------------------------------------------------------

# A place in a text for `format`: attributes of values are not looked up.
_PLACE = re.compile(r"\{(\w*)(?::([^{}]*))?\}")


def _list_pop(of: list[Any], index: Any = -1) -> Any:
    item = item_of(of, index)
    del of[index]
    return item


def _get(of: dict[Any, Located], key: Any, default: Any = None) -> Any:
    return readable(of[as_key(key)].value) if as_key(key) in of else default


def _setdefault(of: dict[Any, Located], key: Any, default: Any = None) -> Any:
    return readable(of.setdefault(as_key(key), Located(default, 0)).value)


_NEEDED: Any = object()


def _dict_pop(of: dict[Any, Located], key: Any, default: Any = _NEEDED) -> Any:
    if as_key(key) not in of and default is not _NEEDED:
        return default
    value = item_of(of, key)
    del of[as_key(key)]
    return value


def _format(text: str, *arguments: Any, **keywords: Any) -> str:
    given = {**{str(number): each for number, each in enumerate(arguments)}, **keywords}
    numbers = map(str, range(len(text)))

    def filled(place: re.Match[str]) -> str:
        name = place[1] or next(numbers)
        if name not in given:
            raise NotUnderstoodError("a format is not understood")
        return formatted(given[name], place[2] or "")

    longest = max((len(each) for each in given.values() if isinstance(each, str)), default=0)
    if longest * len(text) > MAX_ITEMS * 10 or set("{}") & set(_PLACE.sub("", text)):
        raise NotUnderstoodError("a format is not understood")
    return _PLACE.sub(filled, text)


def _join(glue: str, parts: Any) -> str:
    texts = items_of(parts)
    if not all(isinstance(each, str) for each in texts) or sum(map(len, texts)) > MAX_ITEMS:
        raise NotUnderstoodError("only texts can be joined")
    # Checked before, because the text itself would be too long.
    if len(glue) * len(texts) > MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    return glue.join(texts)


def _text_method(name: str) -> Callable[..., Any]:
    def call(text: str, *arguments: Any) -> Any:
        if not all(isinstance(each, str | int) for each in arguments):
            raise NotUnderstoodError(f".{name}() is not understood with these arguments")
        if any(isinstance(each, int) and each > 1000 for each in arguments):
            raise NotUnderstoodError("a list is too long")
        if name == "replace" and len(text) * sum(len(str(each)) for each in arguments) > MAX_ITEMS:
            raise NotUnderstoodError("a list is too long")
        return checked(getattr(text, name), *arguments)

    return call


_TEXT_METHODS = (
    *("upper", "lower", "strip", "lstrip", "rstrip", "title", "capitalize", "replace", "split"),
    *("startswith", "endswith", "isdigit", "isalpha", "zfill", "removeprefix", "removesuffix"),
)
_METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    Vector: {
        "rotate": lambda of, angle: checked(of.rotated, *numbers_only((angle,))),
        "length": lambda of: checked(math.hypot, *of),
        "copy": Vector,
    },
    list: {
        "append": list.append,
        "extend": lambda of, items: of.extend(items_of(items)),
        "insert": lambda of, index, item: checked(of.insert, index, item),
        "pop": _list_pop,
        "reverse": list.reverse,
        "clear": list.clear,
        "copy": list,
        "tolist": list,
    },
    dict: {
        "items": lambda of: [[key, readable(each.value)] for key, each in of.items()],
        "keys": list,
        "values": lambda of: [readable(each.value) for each in of.values()],
        "get": _get,
        "setdefault": _setdefault,
        "pop": _dict_pop,
        "update": lambda of, *given, **more: of.update(table(*given, **more)),
        "copy": dict,
        "clear": dict.clear,
    },
    str: {**{name: _text_method(name) for name in _TEXT_METHODS}, "format": _format, "join": _join},
}


def method_called(of: Any, name: str, arguments: tuple[Any, ...], keywords: Mapping[str, Any]) -> Any:
    """The result of a method of a list, dict, text or vector. Raises NotUnderstoodError."""
    kinds = [kind for kind in _METHODS if isinstance(of, kind) and name in _METHODS[kind]]
    if not kinds:
        raise NotUnderstoodError(f".{name}() is not understood")
    # Checked before, because the value itself would grow.
    given = [arguments[0]] if name in ("extend", "update") and arguments else [arguments]
    if isinstance(of, list | dict) and len(of) + sum(map(_size, given)) > MAX_ITEMS:
        raise NotUnderstoodError("what is added is no list, or too long")
    try:
        return bounded(_METHODS[kinds[0]][name](of, *arguments, **keywords))
    except TypeError:
        raise NotUnderstoodError(f".{name}() is not understood with these arguments") from None


def _size(value: Any) -> int:
    return len(value) if isinstance(value, list | dict | str) else 0
