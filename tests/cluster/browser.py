"""browser.py URL TOKEN SCREENSHOT: opens the window in headless Chromium as a person would. Run by web_test.py."""
import sys

from playwright.sync_api import expect, sync_playwright

url, token, screenshot = sys.argv[1:]
PICTURE = "() => { const c = document.getElementById('view'); return c.width ? c.toDataURL() : '' }"
LIT = """() => { const c = document.getElementById('view'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
         let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] + d[i + 1] + d[i + 2] > 60; return n / (d.length / 4) }"""

with sync_playwright() as p:
    browser = p.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
    page = browser.new_page(viewport={"width": 1280, "height": 900}, bypass_csp=True)  # for the questions below
    errors, requests = [], []
    page.on("pageerror", lambda e: errors.append(str(e)))
    page.on("request", lambda r: requests.append(r.url))
    page.goto(url)
    page.locator("#token").fill("not the token")
    page.locator("#enter").click()
    expect(page.locator("#ask")).to_be_visible()  # asks again
    page.locator("#token").fill(token)
    page.locator("#enter").click()
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt", timeout=20000)
    page.wait_for_function(f"({LIT})() > 0.3", timeout=20000)
    first = page.evaluate(PICTURE)
    page.wait_for_function("before => document.getElementById('view').toDataURL() !== before", arg=first, timeout=20000)
    expect(page.locator("#hosts tr")).to_have_count(2)
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator("#pixel")).to_contain_text("x 160")
    before = page.evaluate(LIT)
    page.locator("#exposure").fill("-6")
    page.wait_for_function(f"before => ({LIT})() < before / 2", arg=before, timeout=5000)
    page.locator("#exposure").fill("0")
    page.wait_for_function("() => document.querySelector('#chart path')", timeout=30000)
    page.locator("#swap").click()
    expect(page.locator("#over")).to_have_text("cost")
    page.locator("#swap").click()
    page.screenshot(path=screenshot)
    page.on("dialog", lambda d: d.accept())
    page.locator("#cancel").click()
    expect(page.locator("#cancel")).to_be_disabled(timeout=20000)
    browser.close()
    assert not errors, errors
    assert all(r.startswith(url) or r.startswith("data:") for r in requests), requests
