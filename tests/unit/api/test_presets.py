"""Presets and examples are specifications, and say what the paper says."""

from pathlib import Path

import pytest
import yaml
from nerfmodal.spec import ScanSpec, SimulationSource

from services.api.presets import DEFAULT, PAPER, PAPER_COUPLED, PAPER_OFF_BIN, PRESETS

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.name)
def test_every_example_is_a_specification(path: Path) -> None:
    ScanSpec.model_validate(yaml.safe_load(path.read_text()))


def test_the_demo_runs_the_default_preset() -> None:
    assert ScanSpec.model_validate(yaml.safe_load((EXAMPLES / "acai.yaml").read_text())) == DEFAULT


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_survive_json(name: str) -> None:
    assert ScanSpec.model_validate_json(PRESETS[name].model_dump_json()) == PRESETS[name]


def test_every_leaf_has_three_modes_with_phases_of_its_own() -> None:
    source = DEFAULT.source
    assert isinstance(source, SimulationSource)
    for frequency in (2, 5, 10):
        modes = [mode for mode in source.motion if mode.frequency_hz == frequency]
        assert sorted(mode.organ for mode in modes) == [f"leaf_{leaf}" for leaf in range(5)]
        assert len({mode.phase_deg for mode in modes}) == 5


def test_the_paper_preset_has_the_papers_numbers() -> None:
    source = PAPER.source
    assert isinstance(source, SimulationSource)
    assert (source.rig.cameras, source.rig.width_px, source.frames, source.frame_rate_hz) == (50, 1920, 90, 30)
    assert (PAPER.reconstruction.iterations, PAPER.reconstruction.fine_tune_iterations) == (17_000, 3_000)


def test_the_papers_siblings_differ_in_one_thing_alone() -> None:
    assert PAPER_COUPLED.source.model_copy(update={"coupled": False}) == PAPER.source
    assert isinstance(PAPER.source, SimulationSource)
    assert isinstance(PAPER_OFF_BIN.source, SimulationSource)
    plain = [mode.model_copy(update={"frequency_hz": 1}) for mode in PAPER.source.motion]
    assert [mode.model_copy(update={"frequency_hz": 1}) for mode in PAPER_OFF_BIN.source.motion] == plain
    assert {mode.frequency_hz for mode in PAPER_OFF_BIN.source.motion} == {2.17, 4.83, 9.61, 1.07}
    bins = {round(3 * mode.frequency_hz, 9) % 1 for mode in PAPER.source.motion}
    assert bins == {0.0}
