"""Test settings: a deterministic hypothesis profile, and where the real data is."""

import os
import pathlib

import hypothesis
import pytest

hypothesis.settings.register_profile("fixed", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("fixed")

DATA = pathlib.Path(__file__).parent / "data"


@pytest.fixture(scope="session")
def conformance() -> pathlib.Path:
    """Folder of other software's answers that are kept with the tests."""
    return DATA


@pytest.fixture(scope="session")
def real_data() -> pathlib.Path:
    """Folder of real maps and measurements, named by ``GLOSSY_DATA``."""
    folder = os.environ.get("GLOSSY_DATA")
    if not folder or not pathlib.Path(folder).is_dir():
        pytest.skip("real maps are not here: set GLOSSY_DATA to their folder")
    return pathlib.Path(folder)
