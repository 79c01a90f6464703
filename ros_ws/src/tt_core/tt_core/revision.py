"""The revision of this software: as git describes it where there is a repository, else the version of the package."""

from __future__ import annotations

import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

GIT_TIMEOUT = 2.0  # s, after which git is given up


def package_version(package: str) -> str:
    """Return the version of an installed package, "unknown" if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def revision() -> str:
    """Return the revision of this software as `git describe` gives it, e.g. "v0.1.0-12-g1a2b3c4-dirty", else the version of tt_core."""
    command = ["git", "-C", str(Path(__file__).resolve().parent), "describe", "--always", "--dirty", "--tags"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=GIT_TIMEOUT, check=True)
    except (OSError, subprocess.SubprocessError):
        return package_version("tt_core")
    return done.stdout.strip()
