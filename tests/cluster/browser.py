"""browser.py URL TOKEN SCREENSHOT: opens the window in headless Chromium as a person would. Run by web_test.py."""
import sys

import window_page
from playwright.sync_api import expect

url, token, screenshot = sys.argv[1:]

with window_page.opened(url, token, 1280, lambda page: expect(page.locator("#ask")).to_be_visible()) as page:  # asks again
    expect(page.locator("#scene")).to_have_text("killeroo-path.pbrt", timeout=20000)
    window_page.look_at_the_picture(page, 160, 0.3)
    page.wait_for_function("() => document.querySelector('#chart path')", timeout=30000)
    page.locator("#swap").click()
    expect(page.locator("#over")).to_have_text("cost")
    page.locator("#swap").click()
    page.screenshot(path=screenshot)
    window_page.cancel(page)
