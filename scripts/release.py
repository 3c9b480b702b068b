#!/usr/bin/env python3
"""Make a release: one commit with its tag, the two packages, checked, and their upload.

    python scripts/release.py 0.1.0 --dry-run
    python scripts/release.py 0.1.0

Everything is first done in a clone: version, changelog and CITATION.cff, commit and tag. Both packages are
built twice with the same bytes, their metadata is checked, and the wheel is installed from a folder without
an index. Only then are the commit and its tag fetched into this repository and pushed, and the packages
uploaded. With --dry-run nothing leaves the clone.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VERSION = re.compile(r"\d+\.\d+\.\d+")
UNRELEASED = "## [Unreleased]\n"
REPOSITORY = "https://github.com/simmer-tui/simmer-tui"


class ReleaseError(Exception):
    """A problem that must be fixed before a release; the message describes it."""


def as_numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version such as 0.10.2, for comparison."""
    return tuple(map(int, version.split(".")))


def released_versions(changelog: str) -> list[str]:
    """The versions that a changelog has, newest first."""
    return re.findall(r"^## \[(\d[^\]]*)\]", changelog, re.M)


def released_changelog(text: str, version: str, day: str) -> str:
    """The changelog with the unreleased entries under a version. Raises ReleaseError if there are none, or
    the version is not newer than those before."""
    before, heading, rest = text.partition(UNRELEASED)
    entries = re.split(r"^(?:## |\[Unreleased\]:)", rest, maxsplit=1, flags=re.M)[0]
    if not heading or "\n- " not in entries:
        raise ReleaseError("CHANGELOG.md has nothing under [Unreleased]: say what users will notice")
    known = released_versions(text)
    if known and as_numbers(version) <= as_numbers(known[0]):
        raise ReleaseError(f"{version} is not newer than {known[0]}, the last release of CHANGELOG.md")
    since = f"compare/v{known[0]}...v{version}" if known else f"commits/v{version}"
    links = f"[Unreleased]: {REPOSITORY}/compare/v{version}...main\n[{version}]: {REPOSITORY}/{since}\n"
    rest = re.sub(r"^\[Unreleased\]:.*\n", links, rest, flags=re.M)
    return f"{before}{heading}\n## [{version}] - {day}\n{rest}"


def released_citation(text: str, version: str, day: str) -> str:
    """CITATION.cff of a version."""
    text = re.sub(r"^date-released: .*\n", "", text, flags=re.M)
    return re.sub(r"^version: .*$", f"version: {version}\ndate-released: {day}", text, flags=re.M)


def released_module(text: str, version: str) -> str:
    """version.py of a version."""
    return re.sub(r'^__version__ = ".*"$', f'__version__ = "{version}"', text, flags=re.M)


def run(command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> str:
    """Run a command and return what it printed. Raises ReleaseError with its output if it failed."""
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, encoding="utf-8"
    )
    if done.returncode:
        raise ReleaseError(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout.strip()


def build(source: Path, out: Path, epoch: int) -> list[Path]:
    """Build wheel and source package of a folder, with no file newer than `epoch`. The build tools are
    installed for this script's Python, so this needs no network. Returns both."""
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch)}
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source)]
    run(command, source, environment)
    return sorted([*out.glob("*.whl"), *out.glob("*.tar.gz")])


def digests(packages: Sequence[Path]) -> dict[str, str]:
    """SHA-256 of each file by its name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in packages}


def checked_packages(source: Path, out: Path, epoch: int) -> list[Path]:
    """Both packages, built twice with the same bytes, and checked as the index checks them."""
    packages = build(source, out, epoch)
    with tempfile.TemporaryDirectory() as again:
        if digests(build(source, Path(again), epoch)) != digests(packages):
            raise ReleaseError("two builds of the same source differ")
    run([sys.executable, "-m", "twine", "check", "--strict", *map(str, packages)], source)
    return packages


def wheelhouse(wheel: Path, folder: Path, *more: str) -> Path:
    """A folder with a wheel, its dependencies and `more`, downloaded or from pip's cache."""
    command = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check"]
    run([*command, "-d", str(folder), str(wheel), *more], folder.parent)
    return folder


def installed_version(house: Path, folder: Path) -> str:
    """The version that the command prints after the package is installed from a folder only."""
    venv.create(folder, with_pip=True)
    commands = folder / ("Scripts" if os.name == "nt" else "bin")
    pip = [str(commands / "python"), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    run([*pip, "--no-index", "--find-links", str(house), "simmer-tui"], folder)
    return run([str(commands / "simmer-tui"), "--version"], folder)


def release(clone: Path, version: str, out: Path) -> list[Path]:
    """Commit, tag and packages of a version, in a clone. Returns the packages."""
    day = datetime.datetime.now(datetime.UTC).date().isoformat()
    changes = {
        "CHANGELOG.md": lambda text: released_changelog(text, version, day),
        "CITATION.cff": lambda text: released_citation(text, version, day),
        "simmer_tui/version.py": lambda text: released_module(text, version),
    }
    for name, changed in changes.items():
        path = clone / name
        path.write_text(changed(path.read_text("utf-8")), encoding="utf-8", newline="\n")
    run(["git", "commit", "-q", "-a", "-m", f"Release {version}"], clone)
    run(["git", "tag", "-a", f"v{version}", "-m", f"SimMeR-TUI {version}"], clone)
    epoch = int(run(["git", "log", "-1", "--format=%ct"], clone))
    packages = checked_packages(clone, out, epoch)
    with tempfile.TemporaryDirectory() as name:
        wheel = next(path for path in packages if path.suffix == ".whl")
        said = installed_version(wheelhouse(wheel, Path(name) / "house"), Path(name) / "venv")
        if said != f"simmer-tui {version}":
            raise ReleaseError(f"the installed package calls itself {said}")
    return packages


def check_repository(repository: Path, version: str) -> None:
    """Raises ReleaseError unless a release can begin."""
    if not VERSION.fullmatch(version):
        raise ReleaseError(f"{version} is no version; one has three numbers, such as 0.1.0")
    if run(["git", "status", "--porcelain"], repository):
        raise ReleaseError("the tree has changes; commit them first")
    if (branch := run(["git", "branch", "--show-current"], repository)) != "main":
        raise ReleaseError(f"releases are made on main, not on {branch or 'a detached commit'}")
    if run(["git", "tag", "--list", f"v{version}"], repository):
        raise ReleaseError(f"there is a v{version} already")


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit code: 1 if a problem must be fixed first."""
    parser = argparse.ArgumentParser(description="Make a release.")
    parser.add_argument("version", help="three numbers, such as 0.1.0")
    parser.add_argument("--dry-run", action="store_true", help="all but the upload, and nothing stays here")
    parser.add_argument("--repository", type=Path, default=ROOT, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    try:
        check_repository(options.repository, options.version)
        with tempfile.TemporaryDirectory() as name:
            clone, out = Path(name) / "clone", Path(name) / "dist"
            run(["git", "clone", "-q", "--branch", "main", str(options.repository), str(clone)], Path(name))
            for key in ("user.name", "user.email"):
                run(["git", "config", key, run(["git", "config", key], options.repository)], clone)
            packages = release(clone, options.version, out)
            for file, digest in digests(packages).items():
                print(f"{digest}  {file}")
            if options.dry_run:
                print(f"{options.version} can be released")
                return 0
            tag = f"v{options.version}"
            run(["git", "pull", "-q", "--ff-only", "--tags", str(clone), "main"], options.repository)
            run(["git", "push", "--atomic", "origin", "main", tag], options.repository)
            upload = [sys.executable, "-m", "twine", "upload", *map(str, packages)]
            return subprocess.run(upload, check=False).returncode
    except ReleaseError as error:
        print(f"no release: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
