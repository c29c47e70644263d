"""A finished scan: its modes, what they are read from, what the cameras saw, and its files."""

import re

import pytest
from playwright.sync_api import Page, expect

DIFFERENCE = """async ([first, second]) => {
    const load = async (data) => { const image = new Image(); image.src = data; await image.decode();
        const canvas = new OffscreenCanvas(image.width, image.height); const c = canvas.getContext('2d');
        c.drawImage(image, 0, 0); return c.getImageData(0, 0, image.width, image.height).data; };
    const [a, b] = [await load(first), await load(second)];
    let changed = 0; for (let k = 0; k < a.length; k += 4) changed += Math.abs(a[k] - b[k]) > 16; return changed; }"""


@pytest.fixture
def scan(page: Page, gallery: tuple[str, str]) -> Page:
    """The page of the scan, on its modes."""
    page.goto(f"{gallery[0]}/#/scans/{gallery[1]}")
    expect(page.locator("table.modes tbody tr")).to_have_count(4)
    return page


def picture(page: Page) -> str:
    """The canvas as it is seen, as a data address."""
    import base64

    shot = page.locator(".stage canvas").screenshot()
    return "data:image/png;base64," + base64.b64encode(shot).decode()


def tab(page: Page, name: str) -> None:
    page.get_by_role("navigation", name="Parts of the scan").get_by_role("link", name=name, exact=True).click()


def test_modes_come_with_deviation_verdict_and_truth(scan: Page):
    first = scan.locator("[data-mode='leaf_0 0']")
    expect(first).to_contain_text("2.1700 ± 0.0030")
    expect(first).to_contain_text("accepted")
    expect(first).to_contain_text("(+0.00 %)")


def test_a_verdict_s_reasons_are_explained(scan: Page):
    scan.locator("[data-mode='leaf_0 1'] button").click()
    facts = scan.get_by_label("The chosen mode")
    expect(facts).to_contain_text("HARMONIC")
    expect(facts).to_contain_text("The frequency is a combination of stronger modes.")
    assert "mode=leaf_0" in scan.url


def test_a_mode_swings_stops_turns_and_grows_with_its_slider(scan: Page):
    canvas = scan.locator(".stage canvas")
    expect(canvas).to_have_attribute("data-points", "5900")
    expect(canvas).to_have_attribute("data-fps", re.compile(r"\d"))
    scan.get_by_role("button", name="Stop").click()
    still = [picture(scan), picture(scan)]
    assert scan.evaluate(DIFFERENCE, still) == 0
    canvas.focus()
    scan.keyboard.press("ArrowLeft")
    scan.wait_for_timeout(200)
    turned = picture(scan)
    assert scan.evaluate(DIFFERENCE, [still[0], turned]) > 300
    scan.get_by_label("Amplitude").fill("0")
    scan.wait_for_timeout(200)
    rest = picture(scan)
    scan.get_by_label("Amplitude").fill("0.3")
    scan.get_by_role("button", name="Play").click()
    scan.wait_for_timeout(700)
    assert scan.evaluate(DIFFERENCE, [rest, picture(scan)]) > 300


COUNTED = """const gl = WebGL2RenderingContext.prototype; window.sent = {pictures: 0, arrays: 0};
    for (const [name, what] of [['bufferData', 'arrays'], ['bufferSubData', 'arrays'], ['drawArrays', 'pictures']]) {
        const plain = gl[name]; gl[name] = function (...given) { sent[what]++; return plain.apply(this, given); }; }"""


def test_a_swinging_mode_sends_the_gpu_no_points_anew(page: Page, gallery: tuple[str, str]):
    """The shape is there from the beginning: a picture costs one number, however many points there are."""
    page.add_init_script(COUNTED)
    page.goto(f"{gallery[0]}/#/scans/{gallery[1]}")
    expect(page.locator(".stage canvas")).to_have_attribute("data-fps", re.compile(r"\d"))
    before = page.evaluate("({...sent})")
    page.wait_for_timeout(1000)
    after = page.evaluate("({...sent})")
    assert after["arrays"] == before["arrays"]
    assert after["pictures"] > before["pictures"] + 3


def test_dragging_turns_the_camera_and_colour_shows_displacement(scan: Page):
    scan.get_by_role("button", name="Stop").click()
    before = picture(scan)
    box = scan.locator(".stage canvas").bounding_box()
    assert box is not None
    scan.mouse.move(box["x"] + 200, box["y"] + 200)
    scan.mouse.down()
    scan.mouse.move(box["x"] + 320, box["y"] + 240, steps=4)
    scan.mouse.up()
    scan.wait_for_timeout(200)
    after = picture(scan)
    assert scan.evaluate(DIFFERENCE, [before, after]) > 300
    scan.get_by_label("colour by displacement").check()
    scan.wait_for_timeout(200)
    assert scan.evaluate(DIFFERENCE, [after, picture(scan)]) > 300


def test_signals_show_coordinates_spectra_eigenvalues_of_the_chosen_organ(scan: Page):
    tab(scan, "Signals")
    expect(scan.locator(".uplot")).to_have_count(7)  # three modes twice, and the eigenvalues
    expect(scan.get_by_role("img", name="Mode 0: 2.1700 ± 0.0030 Hz")).to_be_visible()
    expect(scan.get_by_text("components kept")).to_be_visible()
    scan.get_by_label("Organ").select_option("trunk")
    expect(scan.locator(".uplot")).to_have_count(3)
    expect(scan.get_by_role("img", name="Mode 0: 1.0700 ± 0.0040 Hz")).to_be_visible()


def test_pictures_by_camera_and_frame(scan: Page):
    tab(scan, "Pictures")
    expect(scan.locator(".pictures figure")).to_have_count(14)
    for camera in range(14):
        expect(scan.locator(".pictures img").nth(camera)).to_have_js_property("naturalWidth", 64)
    scan.locator(".pictures button").nth(3).click()
    expect(scan.get_by_role("img", name="Camera cam03, frame 0")).to_be_visible()
    scan.get_by_label("Frame 0 of 90").fill("7")
    expect(scan.get_by_text("The pictures of frame 7 are not made yet.")).to_be_visible()


def test_the_cloud_of_a_frame_stands_in_space(scan: Page):
    tab(scan, "Point cloud")
    expect(scan.locator(".stage canvas")).to_have_attribute("data-points", "5900")
    expect(scan.get_by_text("5,900 of 5,900 points", exact=False)).to_be_visible()


def test_files_are_listed_and_saved(scan: Page):
    tab(scan, "Files")
    with scan.expect_download() as saved:
        scan.get_by_role("button", name="modes.csv").click()
    assert saved.value.path().read_text().startswith("organ")
    expect(scan.get_by_role("link", name="Open the report")).to_be_visible()
