"""What several test modules share: the real recordings."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings: $TINYEKF_DATA, by default ../shared/data beside the repository.

    Without it a test is skipped, except in CI, where it fails.
    """
    folder = Path(os.environ.get("TINYEKF_DATA") or "../shared/data")
    if not folder.is_absolute():
        folder = (REPOSITORY / folder).resolve()
    if not folder.is_dir():
        why = f"no recordings in {folder}: set TINYEKF_DATA to the folder that holds them"
        if os.environ.get("CI"):
            pytest.fail(why)
        pytest.skip(why)
    return folder
