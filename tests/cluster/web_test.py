"""The window of a render: the page, the API, the figures for Prometheus, and the stream to a viewer."""
import http.client
import json
import os
import pathlib
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import unittest

import numpy as np
import support
from support import measure

SIZE = 320
BYTES_PER_SECOND = 200_000
TOKEN = "the secret of this test"


def decode_tile(body):
    """x, y, and pixels of a tile (EXT_texture_shared_exponent: mantissas of 9 bits, an exponent of 5)."""
    x, y, w, h, samples = struct.unpack_from("<5I", body)
    bits = np.frombuffer(body, "<u4", offset=20).reshape(h, w)
    unit = np.exp2((bits >> 27).astype(np.float64) - 24)
    return x, y, np.stack([(bits >> shift & 511) * unit for shift in (0, 9, 18)], axis=2), samples


class Web(support.ClusterTest):
    def setUp(self):
        super().setUp()
        self.port = support.free_ports(1)[0]
        self.out = self.folder / "out.exr"

    def begin(self, *options, token=None):
        os.environ.pop("CLOUDRENDERER_TOKEN", None)
        if token:
            os.environ["CLOUDRENDERER_TOKEN"] = token
            self.addCleanup(os.environ.pop, "CLOUDRENDERER_TOKEN", None)
        render = self.start("render", "render", support.SCENE, "-o", self.out, "--resolution", f"{SIZE}x{SIZE}",
                            "--part-size", "512KiB", "--quiet", *options)
        return render

    def begin_window(self, *options, token=None):
        render = self.begin("--web", f"127.0.0.1:{self.port}", *options, token=token)
        self.assertTrue(support.wait_until_listening(self.port), render.text())
        end = time.monotonic() + 20
        while self.ask("/api/jobs/1", token=token)[0] != 200:
            self.assertLess(time.monotonic(), end, render.text())
            time.sleep(0.05)
        return render

    def ask(self, path, method="GET", token=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            given = {"Authorization": f"Bearer {token}"} if token else {}
            connection.request(method, path, headers=given | (headers or {}))
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def test_the_stream_carries_the_picture_within_its_budget(self):
        spp = self.spp_for_frame(5, support.SCENE, f"{SIZE}x{SIZE}")
        render = self.begin_window("--hosts", 2, "--threads", 1, "--spp", spp)
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        connection.request("GET", "/api/jobs/1/stream")
        answer = connection.getresponse()
        self.assertEqual(answer.status, 200)
        picture, jobs, arrived, coarse = np.zeros((SIZE, SIZE, 3)), [], [], 0
        start = time.monotonic()
        while head := answer.read(4):
            body = answer.read(struct.unpack("<I", head)[0])
            arrived.append((time.monotonic() - start, 4 + len(body)))
            if body[0] == 1:
                jobs.append(json.loads(body[1:]))
            elif body[0] == 3:  # all of it coarsely, before anything else
                self.assertFalse(picture.any())
                step, w, h = struct.unpack_from("<3I", body[1:])
                self.assertEqual((w, h, len(body)), (-(-SIZE // step), -(-SIZE // step), 13 + 4 * w * h))
                self.assertLessEqual(w * h, 128 * 128)
                coarse += 1
            else:
                x, y, pixels, _ = decode_tile(body[1:])
                picture[y:y + pixels.shape[0], x:x + pixels.shape[1]] = pixels
        self.assertEqual(render.wait(60), 0, render.text())
        # All of the finished picture has come, to the precision of its code.
        final = measure.read_rgb(self.out)
        off = np.abs(picture - np.clip(final, 0, 65408)) - final.max(axis=2, keepdims=True) / 512
        self.assertLessEqual(off.max(), 1e-6)
        self.assertEqual(coarse, 1)
        self.assertEqual(jobs[-1]["phase"], "done")
        self.assertEqual(jobs[-1]["paths_done"], spp * SIZE * SIZE)
        self.assertGreaterEqual(len(jobs), 3, "a view of the job every second")
        self.assertEqual({h["name"] for h in jobs[-1]["hosts"]}, {"host1", "host2"})
        self.assertGreater(max(sum(j["tasks"].values()) for j in jobs), 0)
        running = [(t, n) for t, n in arrived if t <= jobs[-1]["elapsed_s"] - 2]  # the goodbye may be faster
        seconds = running[-1][0] + 0.25
        self.assertLessEqual(sum(n for _, n in running) / seconds, BYTES_PER_SECOND)

    def test_who_has_not_the_token_learns_nothing(self):
        render = self.begin_window("--spp", 100000, token=TOKEN)
        for path in "/api/jobs", "/api/jobs/1", "/api/jobs/1/stream", "/metrics":
            self.assertEqual(self.ask(path)[0], 401, path)
            self.assertEqual(self.ask(path, token=TOKEN + "x")[0], 401, path)
        own = {"X-Cloudrenderer": "1"}
        self.assertEqual(self.ask("/api/jobs/1/cancel", "POST", headers=own)[0], 401)
        self.assertEqual(self.ask("/")[0], 200, "the page itself, which asks for it")
        self.assertIn(b"cloudrenderer_paths_total", self.ask("/metrics", token=TOKEN)[1])
        # Another page of the viewer's browser cannot set the header.
        self.assertEqual(self.ask("/api/jobs/1/cancel", "POST", token=TOKEN)[0], 403)
        self.assertTrue(render.running())
        self.assertEqual(self.ask("/api/jobs/1/cancel", "POST", token=TOKEN, headers=own)[0], 202)
        self.assertEqual(render.wait(20), 5, render.text())  # as with Ctrl-C
        self.assertTrue(self.out.exists())
        self.assertTrue(self.out.with_suffix(".ckpt").exists())

    def test_without_a_token_only_the_machine_itself_may_look(self):
        render = self.begin_window("--spp", 100000)
        self.assertEqual(self.ask("/api/jobs/1", headers={"Host": "elsewhere.example"})[0], 403)
        self.assertEqual(self.ask("/api/jobs/1", headers={"Host": f"localhost:{self.port}"})[0], 200)
        self.assertEqual(self.ask("/api/jobs/2")[0], 404)
        for garbage in b"\x16\x03\x01\x02\x00\x01", b"GET /" + b"a" * 100000, b"\0" * 5000, b"GET / HTTP/1.1\r\nHost:\r\n\r\n":
            with socket.create_connection(("127.0.0.1", self.port)) as s:
                s.sendall(garbage)
        self.assertEqual(self.ask("/api/jobs/1")[0], 200)
        self.assertTrue(render.running(), render.text())
        strangers = self.run_program_beside("--web", ":0")
        self.assertEqual(strangers.code, 2)
        self.assertIn("it needs a token", strangers.output)
        taken = self.run_program_beside("--web", f"127.0.0.1:{self.port}")
        self.assertIn("cannot listen there", taken.output)

    def run_program_beside(self, *options):
        return measure.run([support.PROGRAM, "render", support.SCENE, "-o", self.folder / "beside.exr", *options], timeout=30)

    def test_tev_gets_every_pixel(self):
        door = socket.create_server(("127.0.0.1", 0))
        render = self.begin("--display", f"127.0.0.1:{door.getsockname()[1]}", "--spp", 8)
        viewer, _ = door.accept()
        data = b""
        while more := viewer.recv(1 << 16):
            data += more
        self.assertEqual(render.wait(30), 0, render.text())
        picture, at, made = None, 0, []
        while at < len(data):
            n, kind = struct.unpack_from("<IB", data, at)
            name, _, rest = data[at + 6:at + n].partition(b"\0")
            self.assertEqual(name, b"killeroo-path.pbrt")
            if kind == 4:
                made.append(struct.unpack_from("<III", rest))
                picture = np.full((SIZE, SIZE, 3), np.nan, np.float32)
            else:
                self.assertEqual(kind, 3)
                channel, _, rest = rest.partition(b"\0")
                x, y, w, h = struct.unpack_from("<4I", rest)
                picture[y:y + h, x:x + w, b"RGB".index(channel)] = np.frombuffer(rest, "<f4", offset=16).reshape(h, w)
            at += n
        self.assertEqual(made, [(SIZE, SIZE, 3)])
        self.assertTrue(np.array_equal(picture, measure.read_rgb(self.out)), "the viewer's picture is not the file's")

    def test_a_browser_shows_the_picture_change_and_ends_the_job(self):
        python = browser_python()
        if not python:
            self.skipTest("Chromium or Playwright is missing")
        render = self.begin_window("--hosts", 2, "--threads", 1, "--spp", 100000, token=TOKEN)
        shot = os.environ.get("CLOUDRENDERER_SCREENSHOT", self.folder / "window.png")
        result = measure.run([python, pathlib.Path(__file__).with_name("browser.py"), f"http://127.0.0.1:{self.port}/", TOKEN, shot],
                             timeout=90)
        self.assertEqual(result.code, 0, result.output)
        self.assertEqual(render.wait(20), 5, render.text())


def browser_python():
    """A Python with Playwright, in a virtual environment under build/; None when it, or Chromium, cannot be had."""
    if not pathlib.Path("/usr/bin/chromium").exists():
        return None
    venv = measure.ROOT / "build" / "playwright-venv"
    python = venv / "bin" / "python"
    if not (venv / "ready").exists():
        made = subprocess.run(["/usr/bin/python3", "-m", "venv", venv], capture_output=True).returncode == 0
        if not made or subprocess.run([python, "-m", "pip", "install", "-q", "playwright"], capture_output=True).returncode != 0:
            return None
        (venv / "ready").touch()
    return python


if __name__ == "__main__":
    support.main()
