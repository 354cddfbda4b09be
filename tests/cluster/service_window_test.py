"""The window of a service: its page in a browser, what is pushed to it, and pictures of frames that are not done."""
import http.client
import json
import os
import pathlib
import struct
import threading
import time

import numpy as np
import service_support
import service_test
import support
from support import measure
from web_test import BYTES_PER_SECOND, browser_python, decode_tile

SIZE = 96
LONG = ["--spp", "1000000", "--resolution", f"{SIZE}x{SIZE}", *service_test.SPLIT]


def processor_s(pid):
    """Processor seconds of a process, without its children."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children_of(pid):
    return [int(p) for p in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


class Window(service_support.ServiceTest):
    def open(self, user, path):
        """A connection and the answer on it, whose body has not been read."""
        connection = http.client.HTTPConnection("127.0.0.1", self.api_port, timeout=20)
        self.addCleanup(connection.close)
        connection.request("GET", path, headers={"Authorization": f"Bearer {user}'s token"})
        answer = connection.getresponse()
        return connection, answer

    def long_job(self, user, *options):
        job = self.submit(user, support.SCENE, *LONG, *options)
        self.wait_for(lambda: self.ask(user, "GET", f"/v1/jobs/{job}/frames/0/progress")[1].get("paths_done", 0) > SIZE * SIZE, "no progress")
        return job

    def preview(self, user, job):
        status, content = self.ask(user, "GET", f"/v1/jobs/{job}/frames/0/preview.exr")
        self.assertEqual(status, 200, content)
        path = self.folder / "preview.exr"
        path.write_bytes(content)
        return measure.read_rgb(path)

    def test_unfinished_frames_have_pictures(self):
        self.serve(1)
        other = self.long_job("bob", "--seed", 5)
        job = self.long_job("ann")
        status, page = self.ask(None, "GET", "/")  # which asks for the token
        self.assertEqual((status, page[:15]), (200, b"<!doctype html>"))
        self.assertNotRegex(page, rb"""(src|href)=["'](?!data:)""", "the page is one file")
        first = self.preview("ann", job)
        self.assertEqual(first.shape, (SIZE, SIZE, 3))
        reference = self.reference("small", support.SCENE, "--spp", 16, "--resolution", f"{SIZE}x{SIZE}", *service_test.SPLIT)
        self.assertLess(abs(first.mean() / reference.mean() - 1), 0.1)
        status, png = self.ask("ann", "GET", f"/v1/jobs/{job}/frames/0/preview.png")
        self.assertEqual((status, png[:4]), (200, b"\x89PNG"))
        self.wait_for(lambda: not np.array_equal(self.preview("ann", job), first), "the preview does not change", 20)
        for path in "preview.exr", "preview.png", "stream", "progress":
            self.assertEqual(self.ask("bob", "GET", f"/v1/jobs/{job}/frames/0/{path}")[0], 404, path)
            self.assertEqual(self.ask(None, "GET", f"/v1/jobs/{job}/frames/0/{path}")[0], 401, path)
            self.assertEqual(self.ask("ann", "GET", f"/v1/jobs/{job}/frames/1/{path}")[0], 404, path)
        self.command("ann", "fetch", job, "--preview", "-o", self.folder / "fetched")
        self.assertEqual(measure.read_rgb(self.folder / "fetched" / "killeroo-path.preview.exr").shape, first.shape)
        # What was there when it was ended stays to be looked at, and the stream tells it at once.
        self.command("ann", "cancel", job)
        self.wait_for(lambda: self.state("ann", job)["frames"][0]["state"] == "cancelled" and self.ask("ann", "GET", f"/v1/jobs/{job}/frames/0/progress")[0] == 404, "it does not end")
        last = self.preview("ann", job)
        _, answer = self.open("ann", f"/v1/jobs/{job}/frames/0/stream")
        self.assertEqual(answer.status, 200)
        picture, view = np.zeros((SIZE, SIZE, 3)), None
        while head := answer.read(4):
            body = answer.read(struct.unpack("<I", head)[0])
            if body[0] == 1:
                view = json.loads(body[1:])
            else:
                x, y, pixels, _ = decode_tile(body[1:])
                picture[y:y + pixels.shape[0], x:x + pixels.shape[1]] = pixels
        self.assertEqual((view["phase"], view["width"], view["scene"]), ("stopped", SIZE, "killeroo-path.pbrt"))
        self.assertGreater(view["paths_done"], SIZE * SIZE)
        self.assertEqual([h["name"] for h in view["hosts"]], ["worker0"])
        # The host has worked for another job as long: that is not in this one's report.
        self.assertLess(view["cpu_s"], 1.4 * self.state("ann", job)["usage"]["cpu_s"] + 0.3)
        self.assertLessEqual((np.abs(picture - last) - last.max(axis=2, keepdims=True) / 512).max(), 1e-6)
        self.command("bob", "cancel", other)

    def test_pages_are_told_what_changes_and_no_more(self):
        self.serve(2)
        jobs = {"ann": [self.long_job("ann"), self.long_job("ann", "--seed", 3)], "bob": [self.long_job("bob")]}
        managers = children_of(self.service.pid)
        self.assertEqual(len(managers), 3)
        seconds = 5
        pids = [self.service.pid, *managers]
        # Ann's page: her jobs, and a frame.
        counted, threads = [0, 0], []
        def read(number, path, sink):
            _, answer = self.open("ann", path)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                data = answer.read1(1 << 16)
                counted[number] += len(data)
                sink.append(data)
        words, tiles = [], []
        before = [processor_s(p) for p in pids]
        for number, path, sink in (0, "/v1/watch", words), (1, f"/v1/jobs/{jobs['ann'][0]}/frames/0/stream", tiles):
            threads.append(threading.Thread(target=read, args=(number, path, sink)))
            threads[-1].start()
        for thread in threads:
            thread.join()
        used = [100 * (processor_s(p) - b) / seconds for p, b in zip(pids, before)]
        lines = [json.loads(line) for line in b"".join(words).split(b"\n")[:-1] if line]
        self.assertEqual(lines[0]["caller"], {"name": "ann", "admin": False})
        told = [row for line in lines for row in line.get("jobs", [])]
        self.assertEqual({row["id"] for row in told}, set(jobs["ann"]), "nobody else's")
        self.assertGreaterEqual(len([row for row in told if row["id"] == jobs["ann"][0]]), 3, "it changes")
        self.assertGreater(told[-1]["progress"], 0)
        self.assertEqual(told[-1]["hosts"], 2)
        self.assertEqual([u["user"] for u in lines[0]["usage"]["users"]], ["ann"])
        self.assertGreater(counted[1], 4 * SIZE * SIZE, "all of the picture")
        self.assertLess(sum(counted) / seconds, BYTES_PER_SECOND)
        print(f"a page that watches 2 jobs of 3: {sum(counted) / seconds / 1e3:.0f} KB/s; {used[0]:.1f} % of a core for the service and all "
              f"that it does, {sum(used[1:]):.1f} % for the managers")
        # A hundredth of a core, and three ticks of the kernel's clock, by which it is measured.
        self.assertLess(used[0], 1 + 100 * 0.03 / seconds)
        # Nobody takes all places.
        for user, path, places in ("bob", "/v1/watch", 16), ("ann", f"/v1/jobs/{jobs['ann'][1]}/frames/0/stream", 8):
            statuses = [200]
            while statuses[-1] == 200:
                statuses.append(self.open(user, path)[1].status)
            self.assertEqual((statuses[-1], len(statuses) - 2), (429, places), path)
        self.assertEqual(self.ask("ann", "GET", "/v1/jobs")[0], 200)
        _, own = self.open("ann", "/v1/watch")
        self.assertEqual(own.status, 200)
        # Who is a user no more is told nothing more.
        users = json.loads((self.folder / "users.json").read_text())
        (self.folder / "users.json").write_text(json.dumps({"users": [u for u in users["users"] if u["name"] != "ann"]}))
        stream = self.open("root", f"/v1/jobs/{jobs['ann'][0]}/frames/0/stream")[1]
        own.read()  # ends
        self.assertEqual(self.ask("ann", "GET", "/v1/watch")[0], 401)
        self.assertEqual(stream.status, 200, "of an administrator")
        # And the service ends though some look on.
        began = time.monotonic()
        self.service.kill(15)
        self.assertEqual(self.service.wait(15), 0, self.service.text())
        self.assertLess(time.monotonic() - began, 12)

    def test_a_browser_signs_in_watches_and_cancels(self):
        python = browser_python()
        if not python:
            self.skipTest("Chromium or Playwright is missing")
        self.serve(2)
        bob = self.long_job("bob")
        ann = self.long_job("ann")
        shots = os.environ.get("CLOUDRENDERER_SCREENSHOT", self.folder)
        result = measure.run([python, pathlib.Path(__file__).with_name("service_browser.py"), f"http://127.0.0.1:{self.api_port}/", "ann's token",
                              str(ann), str(bob), shots], timeout=90)
        self.assertEqual(result.code, 0, result.output)
        self.wait_for(lambda: self.state("ann", ann)["state"] == "cancelled", "it is not cancelled")
        self.assertEqual(self.state("ann", ann)["priority"], -3)
        self.assertEqual(self.state("bob", bob)["state"], "running")


for inherited in [n for n in dir(service_test.Service) if n.startswith("test_")]:
    setattr(Window, inherited, None)  # they run elsewhere

if __name__ == "__main__":
    support.main()
