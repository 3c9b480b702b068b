"""Sketches by each compiler that is there: all do the same, and tell errors by the sketch's own lines."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui import platform_has
from simmer_tui.cli.main import main
from simmer_tui.errors import ConfigurationError
from simmer_tui.sketch import build
from simmer_tui.sketch.boards import UNO
from simmer_tui.sketch.build import BuiltSketch, build_sketch
from simmer_tui.sketch.compiler import Compiler, find_compiler
from tests.sketch.running import FORMS, run_boards, set_of
from tests.sketch.test_forms import SENT

MILLISECOND = 1_000_000
ZIGLANG = (sys.executable, "-m", "ziglang", "c++")


def command_of(name: str) -> tuple[str, ...]:
    """The command of a compiler, or a skip where it is missing."""
    if name == "ziglang":
        if importlib.util.find_spec("ziglang") is None:
            pytest.skip("there is no ziglang: pip install ziglang")
        return ZIGLANG
    program = shutil.which(name)
    if program is None:
        pytest.skip(f"there is no {name}")
    return (program,)


@pytest.fixture(params=["g++", "clang++", "ziglang"])
def compiler(request: pytest.FixtureRequest) -> Compiler:
    return Compiler(command_of(request.param))


@pytest.mark.slow
@pytest.mark.parametrize(
    "form",
    ["binary_frames", "encoder_ticks", "flag_wait", "millis_states", "number_widths", "two_boards"],
)
def test_another_compiler_makes_the_same_run(form: str, tmp_path: Path) -> None:
    """Its basic blocks are others, and each costs 0.5 us: so its times differ, by microseconds."""
    usual = find_compiler()
    others = [Compiler((path,)) for name in ("clang++",) if (path := shutil.which(name))]
    if importlib.util.find_spec("ziglang") is not None:
        others.append(Compiler(ZIGLANG))
    others = [each for each in others if usual is not None and each.name != usual.name]
    if not others:
        pytest.skip("there is no second C++ compiler")
    configuration = set_of(FORMS / form, tmp_path / "set")
    sent = SENT.get(form, ())
    expected = run_boards(configuration, 5.0, sent)
    for other in others:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(build, "find_compiler", lambda other=other: other)
            first, second = (run_boards(configuration, 5.0, sent) for _ in range(2))
        assert repr(first.events) == repr(second.events)
        assert first.sent == second.sent
        assert first.text == expected.text
        assert len(first.events) == len(expected.events)
        for (mine, _), (usual_time, _) in zip(first.sent, expected.sent, strict=True):
            assert abs(mine - usual_time) < MILLISECOND
        assert first.pose == pytest.approx(expected.pose, abs=0.01)


@pytest.fixture
def built(
    compiler: Compiler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], BuiltSketch]:
    """The sketch of a text, built by one of the compilers."""

    def made(text: str) -> BuiltSketch:
        monkeypatch.setattr(build, "find_compiler", lambda: compiler)
        sketch = tmp_path / "rover.ino"
        sketch.write_text(text, "utf-8")
        return build_sketch(sketch, UNO)

    return made


@pytest.mark.slow
def test_errors_are_told_by_the_lines_of_the_sketch(built: Callable[[str], BuiltSketch]) -> None:
    with pytest.raises(ConfigurationError) as failed:
        built("void setup() { Serial.begn(9600); }\nvoid loop() {\n  sped = 2;\n}\n")
    lines = str(failed.value).splitlines()
    assert [each.split(": ")[0] for each in lines] == ["rover.ino:1", "rover.ino:3"]
    assert lines[0].endswith(": void setup() { Serial.begn(9600); }")
    assert "begn" in lines[0].partition("void setup")[0]
    assert lines[1].endswith(": sped = 2;")


NUMBERS = """int most = 40000;
const unsigned int table[] = {100, 70000};
int bits = 0xFFFF, more = B11111111;
char letter = 200;
int sum(int a, int b) { return a + b; }
\tint both(int a) { return a > 50000 ? 3 : 60000; }
double small = 3.7; int whole = 3.7;
void setup() { analogWrite(5, 300); delay(70000); tone(3, 40000); Serial.write(0xFE); most *= 2; }
void loop() { unsigned int fits = 65535, wraps = -1; byte full = 256; }
"""


@pytest.mark.slow
def test_numbers_that_do_not_fit_are_told_by_each_compiler(built: Callable[[str], BuiltSketch]) -> None:
    told = "rover.ino:{}: this number does not fit: {} becomes {}"
    assert list(built(NUMBERS).warnings) == [
        told.format(*each)
        for each in ((1, 40000, -25536), (2, 70000, 4464), (4, 200, -56), (6, 60000, -5536), (9, 256, 0))
    ]


@pytest.mark.slow
def test_a_function_that_is_nowhere_is_named(built: Callable[[str], BuiltSketch]) -> None:
    with pytest.raises(ConfigurationError, match=r"helper\(\) is used, and defined nowhere"):
        built("void helper();\nvoid setup() { helper(); }\nvoid loop() {}\n")


def test_the_package_has_a_cache_without_a_home_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "ziglang"
    package.mkdir()
    (package / "__init__.py").write_text("", "utf-8")
    (package / "__main__.py").write_text(
        "import os\nprint(os.environ.get('ZIG_GLOBAL_CACHE_DIR', 'its own'))\n", "utf-8"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for name in ("ZIG_GLOBAL_CACHE_DIR", "XDG_CACHE_HOME", "XDG_DATA_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert Compiler(ZIGLANG).version == "its own"
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(platform_has, "data_folder", lambda: tmp_path / "data")
    assert Compiler(ZIGLANG).version == str(tmp_path / "data" / "ziglang")
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", "given")
    assert Compiler(ZIGLANG).version == "given"


def test_without_a_compiler_of_the_system_the_package_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    package = tmp_path / "ziglang"
    package.mkdir()
    (package / "__init__.py").write_text("", "utf-8")
    # It makes the runtime alone.
    (package / "__main__.py").write_text(
        "import sys\nprint('clang version 20.1.2')\n"
        "if 'runtime-' in sys.argv[-1]:\n    open(sys.argv[-1], 'w').close()\n",
        "utf-8",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    found = find_compiler()
    assert found is not None
    assert (found.command, found.name, found.is_gcc) == (ZIGLANG, "ziglang", False)
    main(["doctor"])
    assert "compiled by ziglang: clang version 20.1.2" in capsys.readouterr().out
    # Its first build takes minutes, which is told before.
    monkeypatch.setattr(platform_has, "data_folder", lambda: tmp_path / "data")
    folder = set_of(FORMS / "delay_only", tmp_path / "set").directory
    main(["check", str(folder)])
    assert capsys.readouterr().err.startswith("ziglang compiles its libraries now, which takes minutes")
    assert build.long_build_notice() == ""
