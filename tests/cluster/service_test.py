"""A service with pool workers and several users: uploads, jobs, pictures, what users may see, kills, and a restart."""
import hashlib
import os
import signal
import socket
import ssl
import time
import urllib.request

import numpy as np
import service_support
import support
from support import measure

SPLIT = ["--part-size", "512KiB"]
HEAD = 'Film "image" "integer xresolution" 16 "integer yresolution" 16 Camera "perspective" WorldBegin '
FAST = ["--spp", "4", "--resolution", "80x80", *SPLIT]


class Service(service_support.ServiceTest):
    def test_users_render_side_by_side_and_see_only_their_own(self):
        self.serve()
        ann = self.submit("ann", support.SCENE, *FAST)
        bobs = ["--seed", 7, "--light-paths", "all", *FAST]
        bob = self.submit("bob", support.SCENE, *bobs)
        for user, job in ("ann", ann), ("bob", bob):
            state = self.wait_for_end(user, job)
            self.assertGreater(state["usage"]["rays"], 80 * 80 * 4)
        self.assertTrue(np.array_equal(self.picture("ann", ann), self.reference("ann", support.SCENE, *FAST)))
        self.assertTrue(np.array_equal(self.picture("bob", bob), self.reference("bob", support.SCENE, *bobs)))
        # What hosts have measured is shared out among the jobs, with its price.
        self.wait_for(lambda: all(self.state("root", j)["usage"]["cpu_s"] > 0 for j in (ann, bob)), "nothing is metered")
        usage = self.state("ann", ann)["usage"]
        self.assertAlmostEqual(usage["cost"], usage["host_s"], delta=1e-6 + 1e-6 * usage["cost"])  # 3600 an hour
        # A user is told nothing of others.
        scene = self.state("ann", ann)["scene"]
        for path in (f"/v1/jobs/{ann}", f"/v1/jobs/{ann}/events", f"/v1/jobs/{ann}/frames/0", f"/v1/jobs/{ann}/frames/0/log", f"/v1/scenes/{scene}",
                     f"/v1/jobs/{ann}/frames/0/picture.exr", f"/v1/jobs/{ann}/frames/0/picture.png", f"/v1/jobs/{ann}/frames/0/report"):
            self.assertEqual(self.ask("bob", "GET", path)[0], 404, path)
            self.assertEqual(self.ask(None, "GET", path)[0], 401, path)
            self.assertEqual(self.ask("nobody", "GET", path)[0], 401, path)
            self.assertEqual(self.ask("ann", "GET", path)[0], 200, path)
        self.assertEqual(self.ask("bob", "POST", f"/v1/jobs/{ann}/cancel")[0], 404)
        self.assertEqual(self.ask("bob", "PATCH", f"/v1/jobs/{ann}", {"priority": -1})[0], 404)
        self.assertEqual(self.ask("ann", "PATCH", f"/v1/jobs/{ann}", {"priority": -1})[0], 409, "it has ended")
        self.assertEqual([j["id"] for j in self.ask("bob", "GET", "/v1/jobs")[1]], [bob])
        self.assertEqual([j["id"] for j in self.ask("root", "GET", "/v1/jobs")[1]], [ann, bob])
        self.assertEqual([u["user"] for u in self.ask("bob", "GET", "/v1/usage")[1]["users"]], ["bob"])
        self.assertEqual(self.ask("bob", "POST", "/v1/jobs", {"scene": scene, "files": ["killeroo-path.pbrt"]})[0], 422)
        self.assertEqual(self.ask("bob", "GET", "/v1/metrics")[0], 403)
        self.assertIn(b'cloudrenderer_service_jobs{state="done"} 2', self.ask("root", "GET", "/v1/metrics")[1])
        # A scene that one user has uploaded is missing to another, and so are its files: nobody can ask for contents.
        manifest = {"files": [{k: f[k] for k in ("path", "sha256", "bytes")} for f in self.ask("ann", "GET", f"/v1/scenes/{scene}")[1]["files"]]}
        status, answer = self.ask("root", "POST", "/v1/scenes", manifest)
        self.assertEqual((status, sorted(answer["missing"])), (409, sorted({f["sha256"] for f in manifest["files"]})))
        self.assertEqual(self.ask("root", "GET", f"/v1/blobs/{manifest['files'][0]['sha256']}")[1]["offset"], 0)
        # The commands.
        self.assertIn("done", self.command("ann", "status", ann))
        self.assertIn("frame 0 (killeroo-path.pbrt) done", self.command("ann", "logs", ann))
        self.assertIn("listening on", self.command("ann", "logs", ann, "--frame", 0))
        self.command("ann", "fetch", ann, "-o", self.folder / "fetched")
        self.assertTrue((self.folder / "fetched" / "killeroo-path.exr").exists())
        self.command("bob", "fetch", ann, code=2)
        self.assertNotIn(str(self.folder), self.command("ann", "logs", ann, "--frame", 0), "where the service keeps its files is nobody's business")

    def test_a_service_that_is_killed_goes_on(self):
        spp = self.spp_for_frame(3, support.SCENE, "80x80")
        self.serve()
        options = ["--spp", spp, "--resolution", "80x80", *SPLIT]
        job = self.submit("ann", support.SCENE, *options)
        self.wait_for(lambda: self.ask("ann", "GET", f"/v1/jobs/{job}/frames/0/progress")[1].get("paths_done", 0) > 80 * 80 * spp / 5, "no progress")
        time.sleep(1.2)  # for a record in its checkpoint
        self.service.kill()
        self.service.child.wait()
        other = self.start("second", "manager", "--serve", self.folder / "data", "--listen", f"127.0.0.1:{self.pool_port}", "--api",
                           f"127.0.0.1:{self.api_port}", "--users", self.folder / "users.json")
        self.assertTrue(support.wait_until_listening(self.api_port), other.text())
        third = measure.run([support.PROGRAM, "manager", "--serve", self.folder / "data", "--listen", "127.0.0.1:0", "--api", "127.0.0.1:0",
                             "--users", self.folder / "users.json"], timeout=20)
        self.assertEqual(third.code, 2)
        self.assertIn("another service works with the folder", third.output)
        self.wait_for_end("ann", job)
        self.assertGreater(self.ask("ann", "GET", f"/v1/jobs/{job}/frames/0/report")[1]["paths_restored"], 0)
        self.assertTrue(np.array_equal(self.picture("ann", job), self.reference("ann", support.SCENE, *options)))
        other.kill(15)
        self.assertEqual(other.wait(20), 0, other.text())

    def test_scenes_that_cannot_be_and_jobs_that_are_ended(self):
        self.serve(1, memory="32MiB")
        head = HEAD
        broken = self.write("broken.pbrt", head + '\nShape "trianglemesh" "point P" [0 0 0]\nWorldEnd\n')
        secret = self.write("../secret.ply", "ply\n")
        good = self.write("good.pbrt", head + 'Shape "sphere"\nWorldEnd\n')
        escapes = self.write("escapes.pbrt", head + f'\nShape "plymesh" "string filename" "{secret}"\nWorldEnd\n')
        broken_job = self.submit("ann", broken, good)
        state = self.wait_for_end("ann", broken_job, "failed")
        self.assertEqual([f["state"] for f in state["frames"]], ["failed", "done"])
        self.assertRegex(state["reason"], r"broken.pbrt:2:\d+: error: ")
        self.assertEqual(state["frames"][0]["attempts"], 1, "it is not tried again")
        # By hand, as the command would upload what is named.
        def upload(user, data):
            name = hashlib.sha256(data).hexdigest()
            status, answer = self.ask(user, "PUT", f"/v1/blobs/{name}", data)
            self.assertIn(status, (200, 201), answer)
            return {"sha256": name, "bytes": len(data)}
        status, scene = self.ask("ann", "POST", "/v1/scenes", {"files": [{"path": "a.pbrt", **upload("ann", escapes.read_bytes())}]})
        self.assertEqual(status, 201, scene)
        status, job = self.ask("ann", "POST", "/v1/jobs", {"scene": scene["id"], "files": ["a.pbrt"], "priority": 1})
        self.assertEqual((status, "a priority of 0 at most" in str(job)), (422, True), job)
        status, job = self.ask("ann", "POST", "/v1/jobs", {"scene": scene["id"], "files": ["a.pbrt"]})
        self.assertEqual(status, 201, job)
        self.assertRegex(self.wait_for_end("ann", job["id"], "failed")["reason"], r"^a.pbrt:2:\d+: error: .*outside of the scene's folder")
        # Too large for the only host, which has 32 MiB.
        vertices = " ".join(f"{i % 1000} {i // 1000} {i % 7}" for i in range(300_000))
        indices = " ".join(f"{i} {i + 1} {i + 1000}" for i in range(298_000))
        huge = self.write("huge.pbrt", head + f'Shape "trianglemesh" "point P" [{vertices}] "integer indices" [{indices}]\nWorldEnd\n')
        cannot_fit = r"it cannot fit: the main scene takes .* MiB, its largest part .* MiB .* the largest of 1 hosts has 32 MiB"
        self.assertRegex(self.command("ann", "submit", huge, "--part-size", "1GiB", code=4), rf"(?m)^\d+\nfailed: {cannot_fit}")
        huge_job = self.state("ann", max(job["id"] for job in self.ask("ann", "GET", "/v1/jobs")[1]))
        request = {"scene": huge_job["scene"], "files": [huge_job["frames"][0]["file"]], "options": {"part_size": 1 << 30}}
        status, job = self.ask("ann", "POST", "/v1/jobs?check_s=5", request)
        self.assertEqual((status, job["state"]), (201, "failed"), job)
        self.assertRegex(job["reason"], cannot_fit)
        self.assertEqual(self.ask("ann", "POST", "/v1/jobs?check_s=6", request)[0], 400)
        # Ended by its user, in the middle.
        job = self.submit("ann", support.SCENE, "--spp", 100000, *SPLIT)
        self.wait_for(lambda: self.state("ann", job)["frames"][0]["state"] == "running", "it does not run")
        self.assertIn("has priority -4", self.command("ann", "change", job, "--priority", -4))
        self.assertEqual(self.state("ann", job)["priority"], -4)
        self.assertIn("a priority of 0 at most, got 1", self.command("ann", "change", job, "--priority", 1, code=2))
        self.assertIn("has priority 5", self.command("root", "change", job, "--priority", 5), "an administrator's own limit counts")
        self.command("bob", "change", job, "--priority", -1, code=2)
        self.assertIn("cancelled", self.command("ann", "cancel", job))
        self.wait_for(lambda: self.state("ann", job)["frames"][0]["state"] == "cancelled", "it runs on")
        self.assertEqual(self.ask("ann", "POST", f"/v1/jobs/{job}/cancel")[0], 409)
        self.assertEqual(self.ask("ann", "GET", f"/v1/jobs/{job}/frames/0/picture.exr")[0], 404)
        # Others' hosts and jobs have not suffered.
        self.command("bob", "submit", "--wait", good)

    def test_a_budget_stops_a_job_until_it_is_raised(self):
        spp = self.spp_for_frame(2, support.SCENE, "80x80")
        self.serve(1)
        job = self.submit("ann", support.SCENE, "--spp", spp, "--resolution", "80x80", "--budget", 1, "--on-budget", "ask", *SPLIT)
        state = self.wait_for_end("ann", job, "paused")
        self.assertIn("the job's budget of 1 is used up", state["reason"])
        self.assertLess(state["usage"]["cost"], 6)
        self.command("ann", "resume", job, "--budget", 1000)
        state = self.wait_for_end("ann", job)
        self.assertTrue(np.array_equal(self.picture("ann", job), self.reference("ann", support.SCENE, "--spp", spp, "--resolution", "80x80", *SPLIT)))

    def test_what_users_remove_and_what_is_kept_too_long_goes(self):
        port = support.free_ports(1)[0]
        self.SERVE = ("--log-level", "info", "--keep", "6s", "--disk", "1KiB", "--jobs-at-once", 1, "--ports", f"{port}-{port}")
        self.serve(1)
        scene = self.write("good.pbrt", HEAD + 'Shape "sphere"\nWorldEnd\n')
        with socket.socket() as other:  # somebody else has the only port
            other.bind(("127.0.0.1", port))
            other.listen()
            refused = self.submit("ann", scene, "--retries", 0)
            self.assertIn(f"none of the ports {port}-{port} (--ports) is free", self.wait_for_end("ann", refused, "failed")["reason"])
        first = self.submit("ann", scene)
        self.wait_for_end("ann", first)
        self.assertIn(f"listening on 127.0.0.1:{port}", self.command("ann", "logs", first, "--frame", 0))
        used = self.ask("ann", "GET", "/v1/usage")[1]["users"][0]
        self.assertGreater(used["service_cpu_s"], 0)
        self.command("bob", "remove", first, code=2)
        self.assertIn(f"job {first} is removed", self.command("ann", "remove", first))
        self.assertEqual(self.ask("ann", "GET", f"/v1/jobs/{first}")[0], 404)
        self.assertFalse((self.folder / "data/jobs" / str(first)).exists())
        second = self.submit("ann", scene)
        self.assertGreater(second, first)
        self.wait_for_end("ann", second)
        self.wait_for(lambda: self.ask("ann", "GET", "/v1/jobs")[1] == [], "the job is kept for ever", 20)
        self.assertEqual(list((self.folder / "data/jobs").iterdir()), [])
        self.wait_for(lambda: not any((self.folder / "data/splits").iterdir()), "the split is kept, which nobody needs")
        self.wait_for(lambda: not any((self.folder / "data/trash").iterdir()), "the trash is not emptied")
        self.assertGreaterEqual(self.ask("ann", "GET", "/v1/usage")[1]["users"][0]["cpu_s"], used["cpu_s"])

    def test_the_certificate_that_a_service_makes_is_what_its_users_trust(self):
        self.API = "0.0.0.0"
        self.start_service("service")
        self.start_worker("worker", self.pool_port, 0, "64MiB")
        certificate, key = self.folder / "data/certificate.pem", self.folder / "data/certificate-key.pem"
        self.assertEqual([f"{f.stat().st_mode & 0o777:o}" for f in (certificate, key)], ["644", "600"])
        self.assertIn(str(certificate), self.service.text())
        url = f"https://localhost:{self.api_port}"

        def ask(code, *options, service=url, **environment):
            result = measure.run([support.PROGRAM, "status", "--service", service, "--user-token-file", self.folder / "ann.token", *options],
                                 timeout=60, env=os.environ | environment)
            self.assertEqual(result.code, code, result.output)
            return result.output

        self.assertIn("CLOUDRENDERER_SERVICE_CA", ask(4))
        self.assertIn("missing.pem cannot be read", ask(2, "--service-ca", self.folder / "missing.pem"))
        self.assertIn("has no certificate", ask(4, "--service-ca", self.folder / "users.json"))
        ask(0, "--service-ca", certificate)
        ask(0, CLOUDRENDERER_SERVICE_CA=str(certificate))
        ask(0, "--service-ca", certificate, service=f"https://127.0.0.1:{self.api_port}")
        request = urllib.request.Request(url + "/v1/jobs", headers={"Authorization": "Bearer ann's token"})
        with urllib.request.urlopen(request, context=ssl.create_default_context(cafile=certificate)) as answer:  # as other programs check it
            self.assertEqual(answer.status, 200)
        scene = self.write("good.pbrt", HEAD + 'Shape "sphere"\nWorldEnd\n')
        submitted = measure.run([support.PROGRAM, "submit", scene, "--wait"], timeout=120, env=os.environ | {
            "CLOUDRENDERER_SERVICE": url, "CLOUDRENDERER_SERVICE_CA": str(certificate), "CLOUDRENDERER_USER_TOKEN": "ann's token"})
        self.assertEqual(submitted.code, 0, submitted.output)
        given = certificate.read_bytes()
        for options, same in ((), True), (("--advertise", "localhost"), True), (("--advertise", "farm.example"), False):
            self.service.kill(signal.SIGTERM)
            self.service.child.wait(20)
            self.SERVE = options
            self.start_service("again")
            self.assertEqual(certificate.read_bytes() == given, same, options)
        ask(4, "--service-ca", self.write("old.pem", given.decode()))
        ask(0, "--service-ca", certificate)

    def test_uploads_go_on_and_requests_are_checked(self):
        self.serve(0)
        data = os.urandom(300_000)
        name = hashlib.sha256(data).hexdigest()
        blob = f"/v1/blobs/{name}"
        self.assertEqual(self.ask("ann", "GET", blob)[1], {"sha256": name, "complete": False, "offset": 0})
        self.assertEqual(self.ask("ann", "PUT", blob, data[:100_000], {"Content-Range": "bytes 0-99999/300000"})[0], 202)
        # A connection that breaks in the middle: what came is kept.
        with socket.create_connection(("127.0.0.1", self.api_port)) as s:
            s.sendall(f"PUT {blob} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer ann's token\r\nContent-Length: 200000\r\n"
                      "Content-Range: bytes 100000-299999/300000\r\n\r\n".encode() + data[100_000:150_000])
        self.wait_for(lambda: self.ask("ann", "GET", blob)[1]["offset"] > 100_000, "nothing is kept")
        self.wait_for(lambda: self.ask("ann", "PUT", blob, data[:1], {"Content-Range": "bytes 0-0/300000"})[1].get("offset") == 150_000, "it is still busy")
        self.assertEqual(self.ask("bob", "GET", blob)[1]["offset"], 0)
        self.assertEqual(self.ask("ann", "PUT", blob, data[150_000:], {"Content-Range": "bytes 150000-299999/300000"})[0], 201)
        self.assertEqual(self.ask("ann", "GET", blob)[1], {"sha256": name, "complete": True, "offset": 300_000})
        wrong = "/v1/blobs/" + "0" * 64
        self.assertEqual(self.ask("ann", "PUT", wrong, b"abc")[0], 422)
        self.assertEqual(self.ask("ann", "GET", wrong)[1]["offset"], 0)
        for status, method, path, body, headers in (
                (400, "POST", "/v1/jobs", b"{", {}), (422, "POST", "/v1/jobs", {}, {}), (400, "POST", "/v1/jobs", b"[" * 100_000, {}),
                (413, "POST", "/v1/scenes", b" " * 40_000_000, {}), (415, "POST", "/v1/jobs", b"x", {"Content-Type": "multipart/form-data; boundary=x"}),
                (405, "DELETE", "/v1/jobs", None, {}), (405, "PATCH", "/v1/jobs", b"{}", {}), (404, "PATCH", "/v1/jobs/1", {"priority": 1}, {}), (422, "PATCH", "/v1/jobs/1", {"prior": 1}, {}), (404, "GET", "/v1/jobs/1", None, {}),
                (404, "GET", "/v1/jobs/x", None, {}), (404, "GET", "/page", None, {}), (404, "POST", "/", {}, {}), (404, "GET", "/v1/blobs/short", None, {}),
                (414, "GET", "/v1/" + "x" * 2000, None, {}), (400, "PUT", wrong, b"a", {"Content-Range": "bytes 5-2/9"}),
                (413, "PUT", wrong, b"a", {"Content-Range": "bytes 0-0/1000000000000"}),
                (422, "POST", "/v1/scenes", {"files": [{"path": "../x", "sha256": name, "bytes": 300_000}]}, {}),
                (422, "POST", "/v1/scenes", {"files": [{"path": "x", "sha256": name, "bytes": 1}]}, {}),
                (201, "POST", "/v1/scenes", {"files": [{"path": "x", "sha256": name, "bytes": 300_000}]}, {})):
            got, answer = self.ask("ann", method, path, body, headers)
            self.assertEqual(got, status, (method, path, answer))
            self.assertIn("id" if status == 201 else "error", answer)
        for garbage in b"\x16\x03\x01\x02\x00\x01", b"GET /" + b"a" * 100000, b"\0" * 5000, b"PUT /v1/jobs HTTP/1.1\r\nContent-Length: -5\r\n\r\n":
            with socket.create_connection(("127.0.0.1", self.api_port)) as s:
                s.sendall(garbage)
        self.assertEqual(self.ask("ann", "GET", "/v1/openapi.json")[0], 200)
        self.assertTrue(self.service.running())


if __name__ == "__main__":
    support.main()
