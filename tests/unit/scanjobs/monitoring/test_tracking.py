"""Tracks by law: modes keep their tracks through noise and gaps, never jump silently, and do as a person says."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scanjobs.monitoring.shapes import mac, pack
from scanjobs.monitoring.tracking import Rules, Seen, Tracks, _pair, track

DAY_S = 24 * 3600.0
ALONG = np.linspace(0, 1, 30)
PLACES = np.column_stack([ALONG, 0 * ALONG, 0.2 * ALONG])
BEND = pack(PLACES, (ALONG**2)[:, None], np.array([[0.0, 0.0, 1.0]]))
BEND_TWICE = pack(PLACES, (ALONG**2 * (0.83 - ALONG))[:, None], np.array([[0.0, 0.0, 1.0]]))


def seen(scan: int, mode: int, frequency: float, **values: object) -> Seen:
    values = {"std": 0.003 * frequency, "at": scan * DAY_S / 2} | values
    return Seen(key=(str(scan), "leaf", mode), frequency=frequency, **values)  # type: ignore[arg-type]


def courses_of(scans: Sequence[Sequence[Seen]], tracks: Tracks) -> list[list[int | None]]:
    return [[tracks.placed[mode.key].course for mode in scan] for scan in scans]


def test_noisy_modes_with_gaps_stay_apart() -> None:
    rng = np.random.default_rng(1)
    modes = [2.0, 2.3, 5.0]
    scans = [
        [seen(k, m, f * (1 + rng.normal(0, 0.005))) for m, f in enumerate(modes) if rng.random() > 0.1]
        for k in range(60)
    ]
    tracks = track(scans, {})
    assert len(tracks.courses) == 3
    for scan, places in zip(scans, courses_of(scans, tracks), strict=True):
        for mode, course in zip(scan, places, strict=True):
            assert {key[2] for key in tracks.courses[course or 0].keys} == {mode.key[2]}


def test_crossing_modes_are_told_apart_by_their_shapes() -> None:
    scans = [[seen(k, 0, 2.0 + 0.02 * k, shape=BEND), seen(k, 1, 2.4 - 0.02 * k, shape=BEND_TWICE)] for k in range(21)]
    tracks = track(scans, {})
    assert [len(course.keys) for course in tracks.courses] == [21, 21]
    assert all({key[2] for key in course.keys} in ({0}, {1}) for course in tracks.courses)


def test_crossing_modes_without_shapes_are_doubtful_where_they_meet() -> None:
    scans = [[seen(k, 0, 2.0 + 0.01 * k), seen(k, 1, 2.2 - 0.01 * k)] for k in range(21)]
    links = [track(scans, {}).placed[("10", "leaf", mode)].link for mode in (0, 1)]
    assert links == ["doubtful", "doubtful"]


def test_a_jump_opens_a_new_track() -> None:
    scans = [[seen(k, 0, 2.0)] for k in range(10)] + [[seen(k, 0, 2.3)] for k in range(10, 20)]
    tracks = track(scans, {})
    assert [len(course.keys) for course in tracks.courses] == [10, 10]
    assert [course.alive for course in tracks.courses] == [False, True]
    assert tracks.placed["10", "leaf", 0].link == "born"


def test_a_step_of_five_percent_is_followed_but_doubtful() -> None:
    scans = [[seen(k, 0, 2.0)] for k in range(10)] + [[seen(k, 0, 1.9)] for k in range(10, 14)]
    tracks = track(scans, {})
    assert len(tracks.courses) == 1
    assert [tracks.placed[str(k), "leaf", 0].link for k in (10, 11)] == ["doubtful", "sure"]


def test_a_doubtful_mode_joins_but_does_not_begin_a_track() -> None:
    scans = [[seen(0, 0, 2.0)], [seen(1, 0, 2.0, may_found=False), seen(1, 1, 7.0, may_found=False)]]
    tracks = track(scans, {})
    assert (tracks.placed["1", "leaf", 0].course, tracks.placed["1", "leaf", 1].course) == (0, None)


def test_a_scan_without_the_organ_is_no_absence() -> None:
    scans: list[list[Seen]] = [[seen(0, 0, 2.0)], *([] for _ in range(10)), [seen(11, 0, 2.0)]]
    tracks = track(scans, {})
    assert (len(tracks.courses), tracks.courses[0].missed_in_all) == (1, 0)


def test_an_absent_mode_ends_its_track_after_patience() -> None:
    both = [[seen(k, 0, 2.0), seen(k, 1, 5.0)] for k in range(5)]
    one = [[seen(k, 0, 2.0)] for k in range(5, 5 + Rules().patience + 1)]
    assert [course.alive for course in track(both + one[:-1], {}).courses] == [True, True]
    assert [course.alive for course in track(both + one, {}).courses] == [True, False]


def test_pins_go_before_everything_and_last() -> None:
    scans = [[seen(k, 0, 2.0), seen(k, 1, 5.0)] for k in range(6)]
    tracks = track(scans, {("3", "leaf", 0): "mine", ("4", "leaf", 1): None})
    assert tracks.placed["4", "leaf", 1].course is None
    mine = next(k for k, course in enumerate(tracks.courses) if course.label == "mine")
    assert tracks.courses[mine].keys == [(str(k), "leaf", 0) for k in (3, 4, 5)], "a split goes on by itself"
    first = tracks.placed["0", "leaf", 0].course
    assert first is not None
    assert not tracks.courses[first].alive


def test_tracks_keep_their_identities_when_an_earlier_scan_arrives() -> None:
    scans = [[seen(k, 0, 2.0, before="a"), seen(k, 1, 5.0, before="b")] for k in range(1, 6)]
    tracks = track([[seen(0, 0, 2.0), seen(0, 1, 5.0)], *scans], {})
    assert [course.label for course in tracks.courses] == ["a", "b"]


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.integers(1, 4), st.randoms(use_true_random=False))
def test_pairing_is_the_cheapest_of_all(rows: int, columns: int, random: object) -> None:
    costs = np.array([[random.uniform(0, 20) for _ in range(columns)] for _ in range(rows)])  # type: ignore[attr-defined]
    gate = 16.0

    def total(pairs: Sequence[tuple[int, int]]) -> float:
        return sum(costs[pair] for pair in pairs) + gate / 2 * (rows + columns - 2 * len(pairs))

    subsets = (
        list(zip(chosen, places, strict=True))
        for size in range(min(rows, columns) + 1)
        for chosen in itertools.combinations(range(rows), size)
        for places in itertools.permutations(range(columns), size)
    )
    pairs, found = _pair(costs, gate)
    assert found == pytest.approx(min(total(pairs) for pairs in subsets))
    assert found == pytest.approx(total(pairs))


def test_shapes_of_other_sensors_are_not_compared() -> None:
    moved = pack(PLACES * [1, 1, 3], (ALONG**2)[:, None], np.array([[0.0, 0.0, 1.0]]))
    fewer = pack(PLACES[:10], (ALONG[:10] ** 2)[:, None], np.array([[0.0, 0.0, 1.0]]))
    assert mac(BEND, BEND) == pytest.approx(1.0)
    assert (mac(BEND, BEND_TWICE) or 0.0) < 0.6
    assert [mac(BEND, other) for other in (moved, fewer, None)] == [None, None, None]
