"""What a method needs before its first picture: memory by hand, times that cannot be missed."""

import time

import numpy as np
import pytest
from test_study import study

from glossy.builtin import environment
from glossy.materials import parse_material
from glossy.pyramid import build_pyramid
from glossy.study import preparation
from glossy.study.preparation import WIDER, held_bytes, wider
from glossy.study.report import preparation_table
from glossy.study.run import Study

BUSY = 0.05  # seconds of CPU time of the slow functions below
LEAST = 0.98 * BUSY  # the time of a pixel that finds everything made is taken off


def _burn() -> None:
    start = time.process_time()
    while time.process_time() - start < BUSY:
        pass


def test_held_bytes_count_each_buffer_once_and_leave_out_what_was_given() -> None:
    class Holder:
        def __init__(self) -> None:
            self.whole = np.zeros(100)
            self.parts = {"view": self.whole[10:20], "other": (np.zeros((3, 4), np.float32),)}
            self.given = given

    given = np.zeros(7)
    assert held_bytes(Holder()) == 800 + 48 + 56
    assert held_bytes(Holder(), given) == 800 + 48


def test_held_bytes_of_a_pyramid_are_at_least_its_texels() -> None:
    cube = environment("studio", 16)
    pyramid = build_pyramid(cube)
    texels = sum(level.shape[1] ** 2 for level in pyramid.levels)
    assert held_bytes(pyramid, cube) >= 6 * texels * 3 * 4


def test_wider_widens_every_lobe_and_nothing_else() -> None:
    material = parse_material("mx=.2,my=.1,r0=.3,kd=.1")
    found = wider(material)
    assert found.lobes[0].widths == (WIDER * 0.2, WIDER * 0.1)
    assert (found.kd, found.lobes[0].r0) == (material.kd, material.lobes[0].r0)


@pytest.mark.parametrize("bound", [True, False])
def test_what_is_made_again_is_what_is_timed(bound: bool) -> None:
    """Preparing takes a while, and so does the first pixel of every material."""
    known: set[float] = set()

    def prepare(material: object) -> dict[str, object]:
        _burn()
        return {"array": np.zeros(10)}

    def shade(material: object, made: object) -> None:
        width = material.lobes[0].widths[0]  # type: ignore[attr-defined]
        if width not in known:
            known.add(width)
            _burn()

    material = parse_material("mx=.2")
    found = preparation.measure("c", "m", material, prepare, shade, bound, given=None)
    lazy = 1  # the wider material's first pixel
    assert found.new_map_seconds >= LEAST
    assert found.new_material_seconds >= LEAST * (lazy + bound)
    assert found.bytes == 80


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Study:
    result = study(tmp_path_factory.mktemp("study"), budgets=(7,))
    result.run()
    return result


def test_a_study_holds_a_preparation_for_each_case_and_method(finished: Study) -> None:
    plan = finished.plan
    pairs = [(c.name, m.label) for c in plan.cases for m in plan.methods]
    assert [(p.case, p.method) for p in finished.preparations] == pairs
    assert all(p.new_map_seconds > 0.0 and p.bytes > 0 for p in finished.preparations)
    text = preparation_table(finished)
    assert len(text.splitlines()) == len(pairs) + 2


def test_a_resumed_study_takes_its_preparations_from_the_folder(finished: Study) -> None:
    again = study(finished.store.folder, resume=True, budgets=(7,))
    again.run()
    assert again.preparations == finished.preparations
