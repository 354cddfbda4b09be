"""What the windows of a render and of a service have in common, in headless Chromium. Run with the Python of Playwright."""
import contextlib

from playwright.sync_api import expect, sync_playwright

PICTURE = "() => { const c = document.getElementById('view'); return c.width ? c.toDataURL() : '' }"
LIT = """() => { const c = document.getElementById('view'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
         let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] + d[i + 1] + d[i + 2] > 60; return n / (d.length / 4) }"""


@contextlib.contextmanager
def opened(url, token, width, refused):
    """The page once it has taken `token`; `refused` is called after a wrong one. No error of a script, no other site."""
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": 900}, bypass_csp=True)  # for the questions below
        errors, requests = [], []
        page.on("pageerror", lambda e: errors.append(str(e)))
        page.on("request", lambda r: requests.append(r.url))
        page.goto(url)
        page.locator("#token").fill("not the token")
        page.locator("#enter").click()
        refused(page)
        page.locator("#token").fill(token)
        page.locator("#enter").click()
        yield page
        browser.close()
        assert not errors, errors
        assert all(r.startswith(url) or r.startswith(("data:", "blob:")) for r in requests), requests


def wait_until_lit(page, share):
    page.wait_for_function(f"({LIT})() > {share}", timeout=20000)


def look_at_the_picture(page, middle, share):
    """It is lit, changes, has pixels and an exposure. `middle`: x of the pixel in its middle."""
    wait_until_lit(page, share)
    first = page.evaluate(PICTURE)
    page.wait_for_function("before => document.getElementById('view').toDataURL() !== before", arg=first, timeout=20000)
    expect(page.locator("#hosts tr")).to_have_count(2)
    box = page.locator("#view").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator("#pixel")).to_contain_text(f"x {middle}")
    before = page.evaluate(LIT)
    page.locator("#exposure").fill("-6")
    page.wait_for_function(f"before => ({LIT})() < before / 2", arg=before, timeout=5000)
    page.locator("#exposure").fill("0")


def cancel(page):
    page.on("dialog", lambda d: d.accept())
    page.locator("#cancel").click()
    expect(page.locator("#cancel")).to_be_disabled(timeout=20000)
