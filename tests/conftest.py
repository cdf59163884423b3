"""Test settings: a plain environment, a deterministic hypothesis profile, where the real data is.

What a shell, a terminal or a runner of tests hands down (width, colours, warnings, encodings,
limits, the umask) is set to the same values everywhere, also for the processes that tests start.
"""

import os
import pathlib
import time

import hypothesis
import pytest

hypothesis.settings.register_profile("fixed", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("fixed")

INHERITED = (
    "COLUMNS", "LINES", "TERM", "NO_COLOR", "FORCE_COLOR", "CLICOLOR_FORCE", "PYTHON_COLORS",
    "PYTHONWARNINGS", "PYTHONIOENCODING", "PYTHONUTF8", "PYTHONDEVMODE", "PYTHONINSPECT",
    "PYTHONSTARTUP", "PYTHONVERBOSE", "PYTHONPROFILEIMPORTTIME", "GLOSSY_MAX_MEMORY", "LANGUAGE",
)  # fmt: skip
for name in INHERITED:
    os.environ.pop(name, None)
os.environ.update({"MPLBACKEND": "Agg", "LC_ALL": "C.UTF-8", "TZ": "UTC"})
time.tzset()
os.umask(0o022)

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
