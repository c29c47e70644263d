"""The page's own functions, run in the browser: each against a law or against Python's answer."""

from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from services.api.console.assets import library
from services.api.routes.forks import merged


@pytest.fixture
def call(page: Page, gallery: tuple[str, str]) -> Any:
    """`call(module, expression)`: the expression's value with the module as `m` and one argument as `given`."""
    page.goto(gallery[0])

    def run(module: str, expression: str, given: Any = None) -> Any:
        where = f"/console/{library().version}/{module}"
        return page.evaluate(f"async (given) => {{ const m = await import('{where}'); return {expression}; }}", given)

    return run


def test_a_stream_cut_anywhere_gives_the_same_events(call: Any):
    first = "retry: 1000\nid: 0-1\nevent: ping\ndata: {}\n\n"
    text = first + "id: 0-2\nevent: step\ndata: {\ndata: }\n\n: note\n\nid: 0-3\ndata: é\n\n"
    whole = call("app/stream.js", "m.parser()(given)", text)
    assert [(one["id"], one["type"], one["data"]) for one in whole] == [
        ("0-1", "ping", "{}"),
        ("0-2", "step", "{\n}"),
        ("0-3", "message", "é"),
    ]
    pieces = "[...given].flatMap((feed => letter => feed(letter))(m.parser()))"
    assert call("app/stream.js", pieces, text) == whole


def test_waits_double_to_a_limit_and_are_jittered(call: Any):
    least, most = (call("app/stream.js", f"[0,1,2,3,9].map(n => m.waitBefore(n, () => {end}))") for end in (0, 1))
    assert most == [500, 1000, 2000, 4000, 15000]
    assert least == [half / 2 for half in most]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"a": 1, "b": {"c": 2, "d": 3}}, {"a": 1, "b": {"c": 4}}),
        ({"a": [1, 2]}, {"a": [1]}),
        ({"a": {"x": 1}}, {"a": 5, "n": {"k": [True]}}),
    ],
)
def test_a_merge_patch_of_the_page_makes_what_it_was_made_of_in_the_service(call: Any, before: Any, after: Any):
    patch = call("form/schema.js", "m.mergePatch(given[0], given[1])", [before, after])
    assert merged(before, patch) == after
    assert call("form/schema.js", "m.mergePatch(given, given) === undefined", before)


def test_points_move_as_the_sensors_around_them_and_not_far_from_them(call: Any):
    """A field that is the same everywhere is reproduced exactly, a linear one nearly, and nothing reaches far away."""
    rng = np.random.default_rng(2)
    sensors = np.stack([*np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21)), np.zeros((21, 21))], axis=-1)
    sensors = sensors.reshape(-1, 3)
    points = np.concatenate([np.c_[rng.uniform(0.2, 0.8, (50, 2)), np.zeros(50)], [[3.0, 3.0, 0.0]]])
    shift, tilt = np.tile([0.0, 0.0, 1.0], (len(sensors), 1)), sensors[:, :1] * [0.0, 0.0, 1.0]
    flat = [array.ravel().tolist() for array in (points, sensors, shift, tilt)]
    move = "[...m.motionAt(...given.slice(0, 2).map(a => Float32Array.from(a)), Float32Array.from(given[{}]))]"
    moved = np.array(call("space/attach.js", move.format(2), flat)).reshape(-1, 3)
    np.testing.assert_allclose(moved[:-1], np.tile([0, 0, 1], (50, 1)), atol=1e-6)
    np.testing.assert_array_equal(moved[-1], 0)
    linear = np.array(call("space/attach.js", move.format(3), flat)).reshape(-1, 3)
    np.testing.assert_allclose(linear[:-1, 2], points[:-1, 0], atol=0.02)


def test_slow_pictures_mean_fewer_points_and_quick_ones_more_but_never_what_was_too_much(call: Any):
    slow = "(b => Array.from({length: 20}, () => b.next(8)))(m.adaptive(100000))"
    counts = call("space/adapt.js", slow)
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 2000
    back = call(
        "space/adapt.js", "(b => { b.next(12); return Array.from({length: 30}, () => b.next(60)); })(m.adaptive(1e5))"
    )
    assert back == sorted(back)
    assert 50_000 < back[-1] < 100_000
    assert call("space/adapt.js", "m.adaptive(100000).next(60)") == 100_000


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [(2.00053, 0.00081, "2.00053 ± 0.00081"), (2.17, 0.003, "2.1700 ± 0.0030"), (10.2, None, "10.2"), (None, 1, "–")],
)
def test_a_number_has_the_digits_that_its_deviation_leaves_sure(call: Any, value: Any, std: Any, words: str):
    assert call("app/format.js", "m.measured(given[0], given[1])", [value, std]) == words


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("m.digits(1.03)", "1.030"),
        ("m.digits(12.3456)", "12.35"),
        ("m.digits(null)", "–"),
        ("m.duration(12 * 3600)", "12 h"),
        ("m.duration(3600 + 240)", "1 h 04 min"),
        ("m.sureness(0.99999)", "more than 99.9 % sure"),
        ("m.sureness(0.9871)", "98.7 % sure"),
    ],
)
def test_numbers_are_told_as_a_person_would(call: Any, expression: str, words: str):
    assert call("app/format.js", expression) == words


def test_arrays_are_read_as_numpy_wrote_them(call: Any, gallery: tuple[str, str]):
    """The shape of a mode, deflated; its directions turn it into motion along z."""
    read = """m.readNpz(given, (path, options) => fetch(path, options)).then(all => Object.fromEntries(
        Object.entries(all).map(([name, one]) => [name, [one.shape, [...one.values].slice(0, 6)]])))"""
    found = call("space/npz.js", f"await {read}", f"/v1/scans/{gallery[1]}/artifacts/shapes/leaf_0_0.npz")
    assert found["directions"] == [[1, 3], [0, 0, 1]]
    sensors = found["positions"][0][0]
    assert found["shape"][0] == [sensors, 1]
    assert max(np.abs(found["shape"][1])) <= 1


def test_only_the_named_arrays_of_a_large_file_are_fetched(call: Any, gallery: tuple[str, str]):
    """result.npz has more than a megabyte; one of its arrays needs its end and a piece."""
    read = """(async () => { let bytes = 0;
        const send = async (path, options) => { const answer = await fetch(path, options);
            bytes += Number(answer.headers.get('Content-Length')); return answer; };
        const all = await m.readNpz(given, send, ['times']); return [all.times.values.length, bytes]; })()"""
    frames, fetched = call("space/npz.js", f"await {read}", f"/v1/scans/{gallery[1]}/artifacts/result.npz")
    assert frames == 90
    assert fetched < 150_000
