"""Names of keys in settings.toml, and the check that no key has two meanings."""

import string
import unicodedata
from collections.abc import Iterable, Iterator, Mapping

from msgspec import structs

from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.errors import Problem
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.rules import did_you_mean

DRIVING = ("forward", "back", "turn_left", "turn_right", "sideways_left", "sideways_right")
"""The actions whose keys take the fine step with Shift."""
TAKEN = {
    "colon": "go to the console",
    "enter": "go to the console",
    "tab": "go from pane to pane",
    "shift+tab": "go from pane to pane",
    "ctrl+p": "open the command palette",
    "ctrl+q": "end",
    "f2": "show the next page",
    **dict.fromkeys("1234", "show a page"),
}
"""Keys with a fixed meaning, each with its meaning."""
# Textual shortens some of the names that Unicode gives to signs.
_REPLACED = {
    "solidus": "slash",
    "reverse_solidus": "backslash",
    "commercial_at": "at",
    "hyphen_minus": "minus",
    "plus_sign": "plus",
    "low_line": "underscore",
}


def key_name(character: str) -> str:
    """The name of a character's key: a letter or digit itself, else its Unicode name."""
    # Unicode would call the letter a "latin small letter a".
    if character.isalnum():
        return character
    name = unicodedata.name(character, character).lower().replace("-", "_").replace(" ", "_")
    return _REPLACED.get(name, name)


_NAMED = {
    *("up", "down", "left", "right", "home", "end", "pageup", "pagedown", "insert", "delete"),
    *("backspace", "tab", "enter", "escape", "space"),
    *(f"f{number}" for number in range(1, 25)),
}
_CHARACTERS = {key_name(c) for c in string.ascii_letters + string.digits + string.punctuation}
NAMES = _NAMED | _CHARACTERS


def shifted(key: str) -> str:
    """The key with Shift: `A` for `a`, `shift+up` for `up`."""
    return key.upper() if len(key) == 1 and key.isalpha() else f"shift+{key}"


def keys_of(keys: KeySettings, action: str) -> list[str]:
    """The names of an action's keys."""
    return key_names(getattr(keys, action))


def key_names(text: str) -> list[str]:
    """Names of keys from their comma-separated list. A single sign is replaced by its name, `+` by `plus`."""
    named = [name.strip() for name in text.split(",")]
    return [key_name(name) if len(name) == 1 else name for name in named if name]


def yielding_defaults(given: Mapping[str, str]) -> dict[str, str]:
    """The keys of actions without given keys, if they are fewer than by default.

    `given` are the given keys, by action. They have priority over default keys. So a file that uses a key
    stays valid if a later version gives that key to a new action.
    """
    taken: set[str] = set()
    for action, text in given.items():
        taken |= _meant(action, key_names(text)).keys()
    changed = {}
    for action, default in structs.asdict(KeySettings()).items():
        usual = key_names(default)
        kept = [name for name in usual if not _meant(action, [name]).keys() & taken]
        if action not in given and kept != usual:
            changed[action] = ",".join(kept)
    return changed


def _meant(action: str, names: Iterable[str]) -> dict[str, str]:
    """The keys of an action by these names, each with an addition to its meaning."""
    taken = {}
    for name in names:
        taken[name] = ""
        if action in DRIVING:
            taken[shifted(name)] = ", finely"
    return taken


def key_problems(keys: KeySettings, places: Mapping[str, str]) -> Iterator[Problem]:
    """The problems with the keys: names that do not exist, and keys with two meanings."""
    used = dict(TAKEN)
    helps = {item.name: item.help for item in all_settings()}
    for action in KeySettings.__struct_fields__:
        name = f"keys.{action}"
        place, meaning = places[name], helps[name]
        for key in keys_of(keys, action):
            wrong = _wrong_name(key)
            if wrong:
                yield Problem(place, wrong)
                continue
            for each, addition in _meant(action, [key]).items():
                what = meaning + addition
                if each in used:
                    yield Problem(place, f'needs the key "{each}" to {what}: it is there to {used[each]}')
                # The first action keeps the key; messages about later ones name it.
                used.setdefault(each, what)


def _wrong_name(key: str) -> str:
    *modifiers, base = key.split("+")
    shown = cut(key, WORD)
    if base not in NAMES:
        hint = did_you_mean(base, NAMES) or "; there are letters, digits, up, space, plus, f5 ..."
        return f'names a key "{shown}" that there is not{hint}'
    if "shift" in modifiers and base in _CHARACTERS:
        return f'"{shown}": Shift with a letter is the capital letter, with another sign the sign it gives'
    if any(modifier not in ("shift", "ctrl", "alt") for modifier in modifiers):
        return f'names a key "{shown}": there are shift+, ctrl+ and alt+'
    return ""
