"""service_browser.py URL TOKEN JOB OTHERS_JOB FOLDER: uses a service's window in headless Chromium as a person would. Run by
service_window_test.py; JOB runs and is the user's, OTHERS_JOB is not."""
import sys

import window_page
from playwright.sync_api import expect

url, token, own, other, folder = sys.argv[1:]


def refused(page):
    expect(page.locator("#refused")).to_be_visible()
    expect(page.locator("#joblist li")).to_have_count(0)


with window_page.opened(url, token, 1400, refused) as page:
    expect(page.locator("#ask")).to_be_hidden()
    # The user's job is there, and the picture changes.
    expect(page.locator("#joblist li")).to_have_count(1, timeout=10000)
    expect(page.locator("#joblist b")).to_have_text(own)
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt", timeout=10000)
    window_page.look_at_the_picture(page, 48, 0.2)
    expect(page.locator(".card .sum")).to_contain_text("2 hosts", timeout=10000)
    with page.expect_download() as download:
        page.locator("#png").click()
    assert download.value.suggested_filename == "killeroo-path.png", download.value.suggested_filename
    page.locator("#logs").click()
    expect(page.locator("#logtext")).to_contain_text("listening on")
    page.locator("#log button").click()
    page.screenshot(path=f"{folder}/service.png")
    page.locator("#priority").fill("-3")
    with page.expect_response(lambda answer: answer.request.method == "PATCH"):  # the log is not asked before
        page.locator("#priority").press("Enter")
    page.locator("#logs").click()
    expect(page.locator("#logtext")).to_contain_text("its priority is -3 now")
    page.locator("#log button").click()
    expect(page.locator("#priority")).to_have_value("-3", timeout=5000)
    page.locator("#priority").fill("7")
    page.locator("#priority").press("Enter")
    expect(page.locator("#note")).to_have_text("your jobs may have a priority of 0 at most, got 7")
    expect(page.locator("#priority")).to_have_value("-3")
    # Another user's job is not there, by its address neither.
    page.evaluate(f"location.hash = '#{other}'")
    expect(page.locator("#scene")).to_have_text("No such job")
    status = page.evaluate(f"fetch('/v1/jobs/{other}/frames/0/stream', {{ headers: headers() }}).then(a => a.status)")
    assert status == 404, status
    page.evaluate(f"location.hash = '#{own}'")
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt")
    window_page.cancel(page)
    expect(page.locator(".card")).to_have_attribute("data-state", "cancelled")
    expect(page.locator("#phase")).to_contain_text("cancelled", timeout=20000)
    window_page.wait_until_lit(page, 0.2)  # what there was
    page.locator("#leave").click()
    expect(page.locator("#ask")).to_be_visible()
