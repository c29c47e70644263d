"""Scenes that cannot be are refused with the key and the remedy."""

import pytest
from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate import acai, check_source, default_organs, default_region
from nerfmodal.spec import ScanSpec, SimulationSource
from pydantic import ValidationError

from services.api.complaints import complaints_of
from services.api.presets import PRESETS

BEND = {"organ": "leaf_*", "shape": "bending_1", "frequency_hz": 2.0, "amplitude_m": 0.03}


def source(**changes) -> SimulationSource:
    fields = {"kind": "simulation", "frames": 8, "frame_rate_hz": 30, "motion": [BEND]}
    return SimulationSource.model_validate({**fields, **changes})


@pytest.mark.parametrize(
    ("changes", "pointer", "remedy"),
    [
        ({"palm": {"leaflet_mass_kg": -0.002}}, "/source/palm/leaflet_mass_kg", "above 0"),
        ({"palm": {"leaflets_per_side": -3}}, "/source/palm/leaflets_per_side", "at least 4"),
        ({"rig": {"cameras": 0}}, "/source/rig/cameras", "at least 3"),
        ({"motion": [{**BEND, "frequency_hz": 16}]}, "/source/motion/0/frequency_hz", "frame_rate_hz >= 35.56"),
        ({"motion": [{**BEND, "amplitude_m": -1}]}, "/source/motion/0/amplitude_m", "above 0"),
        ({"excitation": {"kind": "wind", "low_hz": -1}}, "/source/excitation/low_hz", "at least 0"),
        ({"excitation": {"kind": "gale"}}, "/source/excitation/kind", "'wind'"),
        ({"excitation": {"seed": 3}}, "/source/excitation/kind", "free_decay, harmonic, wind, pulse"),
        ({"excitation": {"kind": "wind", "low": 1}}, "/source/excitation/low", "low_hz"),
        (
            {"excitation": {"kind": "wind"}, "motion": [BEND, {**BEND, "damping_ratio": 0}]},
            "/source/motion/1/damping_ratio",
            "above 0",
        ),
        (
            {"excitation": {"kind": "wind", "low_hz": 3, "high_hz": 2}},
            "/source/excitation/high_hz",
            "leave high_hz out",
        ),
        ({"sensor": {"read_noise_e": 5}}, "/source/sensor/read_noise_e", "full_well_e"),
    ],
)
def test_a_specification_that_cannot_be_names_its_key_and_the_remedy(changes, pointer, remedy):
    document = {"source": {"kind": "simulation", "frames": 8, "frame_rate_hz": 30, "motion": [BEND], **changes}}
    with pytest.raises(ValidationError) as refusal:
        ScanSpec.model_validate(document)
    complaint = complaints_of(refusal.value)[0]
    assert complaint.pointer == pointer
    assert remedy in complaint.hint


@pytest.mark.parametrize(
    ("changes", "pointer", "remedy"),
    [
        ({"rig": {"radius_m": 0.3}}, "/source/rig/radius_m", "larger radius_m"),
        ({"rig": {"lowest_deg": -60}}, "/source/rig/lowest_deg", "Raise lowest_deg"),
        ({"motion": [{**BEND, "organ": "frond_*"}]}, "/source/motion/0/organ", "leaf_0, leaf_1"),
        ({"motion": [BEND, {**BEND, "amplitude_m": 0.9}]}, "/source/motion/1/amplitude_m", "0.77"),
        (
            {"motion": [{**BEND, "amplitude_m": 2}], "kinematics": "rotation"},
            "/source/motion/0/amplitude_m",
            "90 degrees",
        ),
        (
            {"motion": [{**BEND, "shape": "torsion_1", "amplitude_m": 0.4}]},
            "/source/motion/0/amplitude_m",
            "45 degrees",
        ),
        (
            {"motion": [{**BEND, "amplitude_m": 0.2}], "excitation": {"kind": "wind"}},
            "/source/motion/0/amplitude_m",
            "",
        ),
        ({"motion": [{**BEND, "shape": "plate_1"}]}, "/source/motion/0/shape", "bending_1"),
        ({"motion": [{**BEND, "organ": "trunk", "shape": "torsion_1"}]}, "/source/motion/0/shape", "twist a leaf"),
        ({"motion": [{**BEND, "direction": [0, 0, 0]}]}, "/source/motion/0/direction", "[0, 0, 1]"),
        (
            {"motion": [{**BEND, "organ": "trunk", "direction": [0.01, 0, 1]}], "kinematics": "rotation"},
            "/source/motion/0/direction",
            "across",
        ),
        ({"sensor": {"shutter_s": 0.05}}, "/source/sensor/shutter_s", "0.03333 s at the most"),
        ({"sensor": {"rolling_shutter_s": 0.05}}, "/source/sensor/rolling_shutter_s", "at the most"),
        ({"excitation": {"kind": "wind", "low_hz": 15}}, "/source/excitation/low_hz", "below 15"),
        ({"structure": "tower", "palm": {"leaves": 3}}, "/source/palm", "structure acai"),
        ({"palm": {"width_m": 3}}, "/source/palm/width_m", "another leaf_length_m"),
    ],
)
def test_a_scene_that_cannot_be_names_its_key_and_the_remedy(changes, pointer, remedy):
    with pytest.raises(InvalidSpec) as refusal:
        check_source(source(**changes))
    assert refusal.value.where == pointer
    assert remedy in str(refusal.value.hint)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_be_filmed(name):
    preset = PRESETS[name].source
    assert isinstance(preset, SimulationSource)
    check_source(preset)


@pytest.mark.parametrize("kinematics", ["linear", "rotation"])
def test_the_paper_and_a_large_swing_are_possible(kinematics):
    check_source(source(kinematics=kinematics))
    check_source(source(kinematics=kinematics, motion=[{**BEND, "amplitude_m": 0.3}]))


def test_regions_of_the_usual_motion_are_the_plants_own():
    plant = acai()
    assert default_region(source()) == plant.region
    assert [organ.region for organ in default_organs(source())] == [organ.region for organ in plant.organs]


def test_regions_grow_with_a_large_swing():
    large = source(motion=[{**BEND, "amplitude_m": 0.3}])
    plant, region = acai(), default_region(large)
    assert region.max_m[2] == pytest.approx(plant.region.max_m[2] + 0.2)
    assert region.min_m[2] == plant.region.min_m[2]
    boxes = {organ.name: organ.region for organ in default_organs(large)}
    assert boxes["leaf_1"].size_m[2] == pytest.approx(plant.regions["leaf_1"].size_m[2] + 0.4)
    assert boxes["trunk"] == plant.regions["trunk"]


def test_riders_have_room_for_what_carries_them():
    sway = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.08}
    free, coupled = (source(motion=[BEND, sway], coupled=coupled) for coupled in (False, True))
    heights = [default_organs(one)[0].region.size_m[2] for one in (free, coupled)]
    assert heights[1] > heights[0] + 0.03
