"""The packages that people install, wheel and source: built, checked, and installed from a folder alone."""

from __future__ import annotations

import email.parser
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
import yaml

from simmer_tui.config.examples import example_files
from simmer_tui.version import REPOSITORY, __version__
from tests.test_docs import script

ROOT = Path(__file__).parents[1]
EPOCH = 1_700_000_000
release = script("release")
CHANGELOG = (ROOT / "CHANGELOG.md").read_text("utf-8")


# -- a release -------------------------------------------------------------------------------------


def test_the_changelog_is_kept() -> None:
    """As Keep a Changelog has it: releases newest first, what is not released on top, the known kinds."""
    headings = re.findall(r"^## (.*)$", CHANGELOG, re.M)
    assert headings[0] == "[Unreleased]"
    assert all(re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", each) for each in headings[1:])
    versions = release.released_versions(CHANGELOG)
    assert versions == sorted(versions, key=release.as_numbers, reverse=True)
    assert not versions or release.as_numbers(__version__) >= release.as_numbers(versions[0])
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.*)$", CHANGELOG, re.M)) <= kinds
    for name in ("Unreleased", *versions):
        assert f"\n[{name}]: {REPOSITORY}/" in CHANGELOG


def test_a_release_names_what_was_unreleased() -> None:
    first = release.released_changelog(CHANGELOG, "91.0.0", "2030-01-02")
    assert re.findall(r"^## (.*)$", first, re.M)[:2] == ["[Unreleased]", "[91.0.0] - 2030-01-02"]
    assert f"\n[Unreleased]: {REPOSITORY}/compare/v91.0.0...main\n[91.0.0]: " in first
    with pytest.raises(release.ReleaseError, match="nothing under"):
        release.released_changelog(first, "91.1.0", "2030-01-03")
    more = first.replace(release.UNRELEASED, f"{release.UNRELEASED}\n### Fixed\n\n- One thing.\n")
    second = release.released_changelog(more, "91.1.0", "2030-01-03")
    assert release.released_versions(second)[:2] == ["91.1.0", "91.0.0"]
    assert f"\n[91.1.0]: {REPOSITORY}/compare/v91.0.0...v91.1.0\n[91.0.0]: " in second
    with pytest.raises(release.ReleaseError, match="not newer than 91"):
        release.released_changelog(more, "91.0.0", "2030-01-03")


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert cited["version"] == __version__
    assert cited["license"] == "AGPL-3.0-or-later"
    assert cited["repository-code"] == REPOSITORY
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    cited = yaml.safe_load(release.released_citation(text, "91.0.0", "2030-01-02"))
    assert (cited["version"], str(cited["date-released"])) == ("91.0.0", "2030-01-02")


@pytest.mark.slow
def test_the_citation_fits_its_schema() -> None:
    command = [tool("uv"), "tool", "run", "-q", "cffconvert", "--validate", "-i", str(ROOT / "CITATION.cff")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_a_release_is_one_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("a source package has no history")
    repository = tmp_path / "repository"
    git = ["git", "-C", str(repository)]
    for command in (
        ["git", "clone", "-q", str(ROOT), str(repository)],
        [*git, "checkout", "-q", "-B", "main"],
        [*git, "config", "user.name", "Somebody"],
        [*git, "config", "user.email", "somebody@example.org"],
    ):
        subprocess.run(command, check=True, capture_output=True)
    options = ["--dry-run", "--repository", str(repository)]
    assert release.main(["91.0.0", *options]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[-1] for line in said[:2]] == [
        "simmer_tui-91.0.0-py3-none-any.whl",
        "simmer_tui-91.0.0.tar.gz",
    ]
    assert said[2:] == ["91.0.0 can be released"]
    assert subprocess.run([*git, "tag"], check=True, capture_output=True).stdout == b""
    (repository / "README.md").write_text("changed", "utf-8")
    assert release.main(["91.0.0", *options]) == 1
    assert "the tree has changes" in capsys.readouterr().err


def test_a_release_needs_a_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert release.main(["next", "--dry-run"]) == 1
    assert "three numbers" in capsys.readouterr().err


def test_issue_forms_ask_what_the_machine_is() -> None:
    """As code hosts read them, or they would show nothing."""
    folder = ROOT / ".github" / "ISSUE_TEMPLATE"
    forms = sorted(path for path in folder.glob("*.yml") if path.name != "config.yml")
    assert len(forms) == 3
    for path in forms:
        form = yaml.safe_load(path.read_text("utf-8"))
        assert set(form) == {"name", "description", "labels", "body"}, path.name
        fields = form["body"]
        assert all(field["type"] in ("textarea", "input", "dropdown", "checkboxes") for field in fields)
        assert len({field["id"] for field in fields}) == len(fields)
        labels = [field["attributes"]["label"] for field in fields]
        assert len(set(labels)) == len(labels)
        assert any("`simmer-tui doctor --json`" in label for label in labels), path.name


# -- the packages ----------------------------------------------------------------------------------


def tool(name: str) -> str:
    """A program beside this Python, or on PATH."""
    beside = Path(sys.executable).parent
    found = shutil.which(name, path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    assert found, f"{name} is not installed; pip install '.[test]' brings it"
    return found


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Source package and wheel, reproducible, and with metadata that the index takes."""
    wheel, source = release.checked_packages(ROOT, tmp_path_factory.mktemp("dist"), EPOCH)
    return source, wheel


@pytest.fixture(scope="module")
def house(packages: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all that is needed to install either package, and to build it."""
    folder = tmp_path_factory.mktemp("house")
    release.wheelhouse(packages[1], folder, "hatchling", "hatch-fancy-pypi-readme", "pip")
    shutil.copy(packages[0], folder)
    return folder


@pytest.mark.slow
def test_packages_say_what_they_are(packages: tuple[Path, Path]) -> None:
    source, wheel = packages
    assert (source.name, wheel.name) == (
        f"simmer_tui-{__version__}.tar.gz",
        f"simmer_tui-{__version__}-py3-none-any.whl",
    )
    with zipfile.ZipFile(wheel) as archive:
        inside = f"simmer_tui-{__version__}.dist-info"
        said = email.parser.Parser().parsestr(archive.read(f"{inside}/METADATA").decode())
        assert f"{inside}/licenses/LICENSE" in archive.namelist()
    assert (said["Name"], said["Version"]) == ("simmer-tui", __version__)
    assert said["License-Expression"] == "AGPL-3.0-or-later"
    assert said["Requires-Python"] == ">=3.11"
    page = said.get_payload()
    assert isinstance(page, str)
    relative = re.findall(r'\]\((?!https://)[^)]*\)|(?:src|srcset)="(?!https://)[^"]*"', page)
    assert not relative, "the index shows the page without the files beside it"


@pytest.mark.slow
def test_the_source_package_has_all_that_its_tests_need(packages: tuple[Path, Path]) -> None:
    """.ci/run runs the quick tests in it; here it is only compared with this folder."""
    with tarfile.open(packages[0]) as archive:
        # Its files are in a folder with the version's name.
        packed = {member.name.partition("/")[2]: member for member in archive if member.isfile()}
        for name in ("simmer_tui", "config", "scripts", "tests", "benchmarks", "docs", ".ci", ".github"):
            for path in (ROOT / name).rglob("*"):
                if path.is_file() and "__pycache__" not in path.parts:
                    assert path.relative_to(ROOT).as_posix() in packed
        for name in (
            "LICENSE",
            "README.md",
            "CHANGELOG.md",
            "CITATION.cff",
            "CONTRIBUTING.md",
            "pyproject.toml",
        ):
            file = archive.extractfile(packed[name])
            assert file is not None
            assert file.read() == (ROOT / name).read_bytes()


def install(how: str, house: Path, place: Path) -> Path:
    """Install the package from a folder alone, as people do; returns where its command lies."""
    alone = ["--no-index", "--find-links", str(house)]
    commands = place / ("Scripts" if os.name == "nt" else "bin")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "UV_"))}
    name = "simmer-tui"
    if how == "pipx":
        environment |= {
            "PIPX_HOME": str(place / "pipx"),
            "PIPX_BIN_DIR": str(commands),
            "PIPX_MAN_DIR": str(place),
        }
        command = [tool("pipx"), "install", "--python", sys.executable, f"--pip-args={' '.join(alone)}", name]
    elif how == "uv tool":
        environment |= {"UV_TOOL_DIR": str(place / "tools"), "UV_TOOL_BIN_DIR": str(commands)}
        command = [tool("uv"), "tool", "install", "-q", "--offline", "--python", sys.executable, *alone, name]
    else:
        subprocess.run([sys.executable, "-m", "venv", str(place)], check=True)
        from_source = ["--no-binary", name] if how == "pip, from source" else []
        command = [str(commands / "python"), "-m", "pip", "install", "-q", *alone, *from_source, name]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    return commands


@pytest.mark.slow
@pytest.mark.parametrize("how", ["pip", "pip, from source", "pipx", "uv tool"])
def test_it_is_installed_from_a_folder_alone(how: str, house: Path, tmp_path: Path) -> None:
    """All that the README speaks of is there: sets, samples, the client, a course, a program that drives."""
    command = str(install(how, house, tmp_path / "installed") / "simmer-tui")
    place = tmp_path / "work"
    place.mkdir()
    environment = {
        name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }

    def said(*arguments: str) -> str:
        done = subprocess.run(
            [command, *arguments],
            cwd=place,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=200,
        )
        assert done.returncode == 0, f"{arguments}: {done.stdout[-1500:]}{done.stderr[-1500:]}"
        return done.stdout

    assert said("--version") == f"simmer-tui {__version__}\n"
    said("examples", "samples")
    written = {path: (place / "samples" / path).read_bytes() for path in example_files()}
    assert written == example_files()
    assert sum(path.is_file() for path in (place / "samples").rglob("*")) == len(written)
    said("init", "course", "--term")
    assert "Course: " in said("check", "course")
    # The copied client is all that wander.py needs, whatever Python runs it.
    program = f'"{sys.executable}" -S samples/wander.py --steps 3'
    ports = ["--port", "0", "--reply-port", "0", "--belief-port", "0"]
    said("--no-ui", "--seed", "7", *ports, "--run", program)


def test_same_files_have_the_same_digests(tmp_path: Path) -> None:
    (tmp_path / "a.whl").write_bytes(b"x")
    assert release.digests([tmp_path / "a.whl"]) == {"a.whl": hashlib.sha256(b"x").hexdigest()}
