"""Keys in settings.toml: names that there are, and one meaning for each."""

from __future__ import annotations

import string
from collections.abc import Callable
from pathlib import Path

import pytest
from textual.keys import Keys, _character_to_key

from simmer_tui.config.keys import NAMES, TAKEN, key_name, key_problems, keys_of, shifted
from simmer_tui.config.loader import load
from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.config.settings_file import Override

PLACES = {item.name: item.name for item in all_settings()}


def problems_of(**keys: str) -> list[str]:
    return [str(problem) for problem in key_problems(KeySettings(**keys), PLACES)]


def test_the_usual_keys_are_fine() -> None:
    assert problems_of() == []


def test_names_are_those_that_the_app_hears() -> None:
    for character in string.ascii_letters + string.digits + string.punctuation:
        assert key_name(character) == _character_to_key(character)
    known = {key.value for key in Keys} | {_character_to_key(c) for c in string.printable if c.isprintable()}
    assert {name for name in NAMES if len(name) > 1} <= known


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"poll": "w"}, 'keys.poll: needs the key "w" to read all sensors: it is there to drive forward'),
        (
            {"poll": "W"},
            'keys.poll: needs the key "W" to read all sensors: it is there to drive forward, finely',
        ),
        ({"poll": "1"}, 'keys.poll: needs the key "1" to read all sensors: it is there to show a page'),
        (
            {"poll": "x,x"},
            'keys.poll: needs the key "x" to read all sensors: it is there to read all sensors',
        ),
        (
            {"stop": "spcae"},
            'keys.stop: names a key "spcae" that there is not; did you mean "space"?',
        ),
        (
            {"stop": "\x07\x1b"},
            'keys.stop: names a key "\\x07\\x1b" that there is not; there are letters, digits, up, space, '
            "plus, f5 ...",
        ),
        (
            {"stop": "shift+x"},
            'keys.stop: "shift+x": Shift with a letter is the capital letter, with another sign the sign it '
            "gives",
        ),
        ({"stop": "super+up"}, 'keys.stop: names a key "super+up": there are shift+, ctrl+ and alt+'),
    ],
)
def test_what_is_wrong_is_said_with_its_place(keys: dict[str, str], problem: str) -> None:
    assert problems_of(**keys) == [problem]


@pytest.mark.parametrize(
    "keys", [{"poll": "ctrl+k, f5"}, {"forward": "k", "poll": "w"}, {"poll": "shift+f5"}]
)
def test_other_keys_may_be_chosen_and_changed_places(keys: dict[str, str]) -> None:
    assert problems_of(**keys) == []


def test_signs_stand_for_their_names() -> None:
    assert keys_of(KeySettings(poll="., ctrl+k ,?"), "poll") == ["full_stop", "ctrl+k", "question_mark"]
    assert [shifted(key) for key in ("a", "up", "1")] == ["A", "shift+up", "shift+1"]
    assert set(TAKEN) <= NAMES | {"shift+tab", "ctrl+p", "ctrl+q"}


def test_a_set_with_such_a_mistake_does_not_load(
    edit: Callable[[str, str, str], None], problems: Callable[..., list[str]]
) -> None:
    edit("settings.toml", "[keys]\n", '[keys]\nstop = "space"\npoll = "space"\n')
    found = problems()
    assert len(found) == 1
    assert found[0].startswith("settings.toml:")
    assert ':poll: needs the key "space"' in found[0] or 'keys.poll: needs the key "space"' in found[0]
    given = problems({"keys.poll": Override("--key-poll", "w")})
    assert given == ['--key-poll: needs the key "w" to read all sensors: it is there to drive forward']
    edit("settings.toml", '[keys]\nstop = "space"\npoll = "space"', '[keys]\npoll = "w"')
    assert problems({"keys.forward": Override("--key-forward", "up")}) == []
    given = problems({"keys.forward": Override("--key-forward", "w")})
    assert len(given) == 1
    assert 'poll: needs the key "w" to read all sensors: it is there to drive forward' in given[0]


def test_a_key_that_is_given_is_no_longer_anothers_by_default(
    edit: Callable[[str, str, str], None], folder: Path
) -> None:
    edit("settings.toml", "[keys]\n", '[keys]\nfollow = "f"\npoll = "W"\n')
    keys = load(folder).settings.keys
    assert (keys.follow, keys.fit) == ("f", "")
    assert (keys.poll, keys.forward) == ("W", "up")
    assert list(key_problems(keys, PLACES)) == []


def test_an_action_may_have_no_key() -> None:
    assert keys_of(KeySettings(poll=""), "poll") == []
    assert problems_of(poll="") == []
