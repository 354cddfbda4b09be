"""service_browser.py URL TOKEN JOB OTHERS_JOB FOLDER: uses a service's window in headless Chromium as a person would. Run by
service_window_test.py; JOB runs and is the user's, OTHERS_JOB is not."""
import sys

from playwright.sync_api import expect, sync_playwright

url, token, own, other, folder = sys.argv[1:]
PICTURE = "() => document.getElementById('view').toDataURL()"
LIT = """() => { const c = document.getElementById('view'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
         let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] + d[i + 1] + d[i + 2] > 60; return n / (d.length / 4) }"""

with sync_playwright() as p:
    browser = p.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
    page = browser.new_page(viewport={"width": 1400, "height": 900}, bypass_csp=True)
    errors, requests = [], []
    page.on("pageerror", lambda e: errors.append(str(e)))
    page.on("request", lambda r: requests.append(r.url))
    page.goto(url)
    page.locator("#token").fill("not the token")
    page.locator("#enter").click()
    expect(page.locator("#refused")).to_be_visible()
    expect(page.locator("#joblist li")).to_have_count(0)
    page.locator("#token").fill(token)
    page.locator("#enter").click()
    expect(page.locator("#ask")).to_be_hidden()
    # The user's job is there, and the picture changes.
    expect(page.locator("#joblist li")).to_have_count(1, timeout=10000)
    expect(page.locator("#joblist b")).to_have_text(own)
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt", timeout=10000)
    page.wait_for_function(f"({LIT})() > 0.2", timeout=20000)
    first = page.evaluate(PICTURE)
    page.wait_for_function("before => document.getElementById('view').toDataURL() !== before", arg=first, timeout=20000)
    expect(page.locator("#hosts tr")).to_have_count(2)
    expect(page.locator(".card .sum")).to_contain_text("2 hosts", timeout=10000)
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator("#pixel")).to_contain_text("x 48")
    before = page.evaluate(LIT)
    page.locator("#exposure").fill("-6")
    page.wait_for_function(f"before => ({LIT})() < before / 2", arg=before, timeout=5000)
    page.locator("#exposure").fill("0")
    with page.expect_download() as download:
        page.locator("#png").click()
    assert download.value.suggested_filename == "killeroo-path.png", download.value.suggested_filename
    page.locator("#logs").click()
    expect(page.locator("#logtext")).to_contain_text("listening on")
    page.locator("#log button").click()
    page.screenshot(path=f"{folder}/service.png")
    # Another user's job is not there, by its address neither.
    page.evaluate(f"location.hash = '#{other}'")
    expect(page.locator("#scene")).to_have_text("No such job")
    status = page.evaluate(f"fetch('/v1/jobs/{other}/frames/0/stream', {{ headers: headers() }}).then(a => a.status)")
    assert status == 404, status
    page.evaluate(f"location.hash = '#{own}'")
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt")
    page.on("dialog", lambda d: d.accept())
    page.locator("#cancel").click()
    expect(page.locator("#cancel")).to_be_disabled(timeout=20000)
    expect(page.locator(".card")).to_have_attribute("data-state", "cancelled")
    expect(page.locator("#phase")).to_contain_text("cancelled", timeout=20000)
    page.wait_for_function(f"({LIT})() > 0.2", timeout=20000)  # what there was
    page.locator("#leave").click()
    expect(page.locator("#ask")).to_be_visible()
    browser.close()
    assert not errors, errors
    assert all(r.startswith(url) or r.startswith(("data:", "blob:")) for r in requests), requests
