"""Functions and methods of Python, `math`, `numpy` and `pygame` that a foreign file may use, within bounds.

Those that call functions of the file (`map`, `sorted` with a key) are in `literal.py`.
"""

import itertools
import json
import math
import string
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from simmer_tui.config.importer.python_values import (
    MAX_ITEMS,
    Class,
    Instance,
    Located,
    Vector,
    as_key,
    as_text,
    bounded,
    checked,
    formatted,
    is_plain,
    item_of,
    numbers_only,
    readable,
    truth,
)
from simmer_tui.errors import NotUnderstoodError, RaisedError

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


def _numeric(function: Callable[..., Any], *arguments: Any) -> Any:
    return checked(function, *numbers_only(arguments))


def items_of(value: Any) -> list[Any]:
    """The items of a value in a loop. Raises NotUnderstoodError."""
    if isinstance(value, Class) and value.members is not None:
        return list(value.members)
    if isinstance(value, Instance) and value.items is not None:
        return value.items
    if not isinstance(value, list | dict | str | tuple):
        raise NotUnderstoodError("a loop needs a list, a range or a dict")
    return list(value)


def _range(*arguments: Any) -> list[int]:
    if not all(isinstance(each, int) for each in arguments):
        raise NotUnderstoodError("a range is understood of whole numbers only")
    return list(checked(range, *arguments))


def _parsed(kind: type[float | int], *arguments: Any) -> Any:
    if len(arguments) > 1 or not all(isinstance(each, int | float | str) for each in arguments):
        raise NotUnderstoodError("a function is understood with numbers only")
    # Python reads at most some thousand digits.
    return checked(kind, *(each[:100] if isinstance(each, str) else each for each in arguments))


def _enumerated(items: Any, start: Any = 0) -> list[list[Any]]:
    return [[start + index, item] for index, item in enumerate(items_of(items))]


def _zipped(*lists: Any, strict: Any = False) -> list[list[Any]]:
    return [list(row) for row in zip(*map(items_of, lists), strict=False)]


def _product(*lists: Any) -> list[list[Any]]:
    if math.prod(len(items_of(each)) for each in lists) > MAX_ITEMS:
        raise NotUnderstoodError("a list is too long")
    return [list(row) for row in itertools.product(*map(items_of, lists))]


def _chain(*lists: Any) -> list[Any]:
    return list(itertools.chain.from_iterable(map(items_of, lists)))


def unique(items: Iterable[Any]) -> list[Any]:
    """The items of a set, in the order in which they came."""
    return [list(key) if isinstance(key, tuple) else key for key in dict.fromkeys(map(as_key, items))]


def table(given: Any = None, /, **more: Any) -> dict[Any, Located]:
    """A dict of another dict or of pairs, and of keywords, whose values are located."""
    made: dict[Any, Located] = {}
    if isinstance(given, dict):
        made.update(given)
    elif given is not None:
        for pair in items_of(given):
            if not isinstance(pair, list | tuple) or len(pair) != 2:
                raise NotUnderstoodError("a dict is understood of another or of pairs only")
            made[as_key(pair[0])] = Located(pair[1], 0)
    made.update(more)
    return made


def _fromkeys(keys: Any, value: Any = None) -> dict[Any, Located]:
    return {as_key(key): Located(value, 0) for key in items_of(keys)}


def _json(text: Any) -> Any:
    if not isinstance(text, str):
        raise NotUnderstoodError("only a text is read as JSON")
    try:
        return _located_tree(json.loads(text), 0)
    except (ValueError, RecursionError):
        raise NotUnderstoodError("a text is no JSON") from None


def _located_tree(value: Any, depth: int) -> Any:
    if depth > 50:
        raise NotUnderstoodError("it is nested too deeply")
    if isinstance(value, dict):
        return {key: Located(_located_tree(each, depth + 1), 0) for key, each in value.items()}
    return [_located_tree(each, depth + 1) for each in value] if isinstance(value, list) else bounded(value)


def _length(value: Any) -> int:
    return len(value) if isinstance(value, dict | str) else len(items_of(value))


def _listed(value: Any = ()) -> list[Any]:
    return items_of(value)


NAMES_OF_MATH = (*_FUNCTIONS, "pi", "tau", "e", "inf")
"""The names that `from math import *` gives."""
CALLS: Mapping[str, Callable[..., Any]] = {
    **{f"math.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{f"numpy.{name}": partial(_numeric, function) for name, function in _FUNCTIONS.items()},
    **{name: partial(_numeric, function) for name, function in _BUILTINS.items()},
    **dict.fromkeys(("list", "tuple", "numpy.array", "numpy.asarray"), _listed),
    **dict.fromkeys(("set", "frozenset"), lambda items=(): unique(items_of(items))),
    **{kind.__name__: partial(_parsed, kind) for kind in (float, int)},
    "bool": lambda value=False: truth(value),
    "range": _range,
    "len": _length,
    "enumerate": _enumerated,
    "zip": _zipped,
    "reversed": lambda items: items_of(items)[::-1],
    "any": lambda items: any(map(truth, items_of(items))),
    "all": lambda items: all(map(truth, items_of(items))),
    "str": lambda value="": as_text(value),
    "divmod": lambda left, right: list(checked(divmod, *numbers_only((left, right)))),
    "dict.fromkeys": _fromkeys,
    "itertools.product": _product,
    "itertools.chain": _chain,
    "json.loads": _json,
    "collections.OrderedDict": table,
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


def _append(to: list[Any], item: Any) -> None:
    to.append(item)


def _extend(to: list[Any], items: Any) -> None:
    to.extend(items_of(items))


def _insert(to: list[Any], index: Any, item: Any) -> None:
    checked(to.insert, index, item)


def _list_pop(of: list[Any], index: Any = -1) -> Any:
    item = item_of(of, index)
    del of[index]
    return item


def _position(of: list[Any], item: Any) -> int:
    for index, each in enumerate(of):
        if is_plain(each) and is_plain(item) and each == item:
            return index
    raise RaisedError("ValueError", "an item is asked for that is not there")


def _remove(of: list[Any], item: Any) -> None:
    del of[_position(of, item)]


def _count(of: list[Any], item: Any) -> int:
    return sum(is_plain(each) and each == item for each in of)


def _pairs(of: dict[Any, Located]) -> list[list[Any]]:
    return [[_unfrozen(key), readable(each.value)] for key, each in of.items()]


def _unfrozen(key: Any) -> Any:
    return list(key) if isinstance(key, tuple) else key


def _values(of: dict[Any, Located]) -> list[Any]:
    return [readable(each.value) for each in of.values()]


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


def _update(of: dict[Any, Located], given: Any = None, /, **more: Any) -> None:
    of.update(table(given, **more))


def _format(text: str, *arguments: Any, **keywords: Any) -> str:
    """`str.format` with plain names and numbers only: attributes of values are not looked up."""
    made, number = [], 0
    for literal, name, form, conversion in checked(lambda: list(string.Formatter().parse(text))):
        made.append(literal)
        if name is None:
            continue
        if not name:
            name, number = str(number), number + 1
        numbered = name.isascii() and name.isdecimal() and len(name) < 4 and int(name) < len(arguments)
        value = arguments[int(name)] if numbered else keywords.get(name)
        if conversion not in (None, "s") or value is None:
            raise NotUnderstoodError("a format is not understood")
        made.append(formatted(value, form or ""))
    return "".join(made)


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
    *("upper", "lower", "strip", "lstrip", "rstrip", "title", "capitalize", "replace", "split", "startswith"),
    *("splitlines", "rsplit", "swapcase", "center", "ljust", "rjust", "partition", "isupper", "islower"),
    *("endswith", "isdigit", "isalpha", "zfill", "removeprefix", "removesuffix", "find", "count"),
)
_METHODS: Mapping[type, Mapping[str, Callable[..., Any]]] = {
    Vector: {
        "rotate": lambda of, angle: checked(of.rotated, *numbers_only((angle,))),
        "length": lambda of: checked(math.hypot, *of),
        "copy": Vector,
    },
    list: {
        "append": _append,
        "extend": _extend,
        "insert": _insert,
        "pop": _list_pop,
        "remove": _remove,
        "index": _position,
        "count": _count,
        "reverse": list.reverse,
        "clear": list.clear,
        "copy": list,
        "tolist": list,
    },
    dict: {
        "items": _pairs,
        "keys": lambda of: [_unfrozen(key) for key in of],
        "values": _values,
        "get": _get,
        "setdefault": _setdefault,
        "pop": _dict_pop,
        "update": _update,
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
    return len(value) if isinstance(value, list | dict | str | tuple) else 0
