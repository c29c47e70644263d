"""What is done where the specification says nothing: frames are followed, the paper's field is refitted."""

import pytest
from nerfmodal.spec import ReconstructionSpec
from pydantic import ValidationError


@pytest.mark.parametrize(
    ("said", "follows"),
    [
        ({}, True),
        ({"field": "mlp"}, False),
        ({"motion": "refit"}, False),
        ({"field": "grid", "motion": "follow"}, True),
    ],
)
def test_the_fast_field_is_followed_and_the_papers_is_refitted(said: dict[str, str], follows: bool) -> None:
    assert ReconstructionSpec.model_validate(said).follows is follows


def test_the_papers_field_cannot_be_followed() -> None:
    with pytest.raises(ValidationError, match="follow needs field: grid"):
        ReconstructionSpec.model_validate({"field": "mlp", "motion": "follow"})


@pytest.mark.parametrize("ground", ["floor", "inf"])
def test_a_ground_is_a_height_or_none(ground: object) -> None:
    with pytest.raises(ValidationError):
        ReconstructionSpec.model_validate({"ground_m": ground})
