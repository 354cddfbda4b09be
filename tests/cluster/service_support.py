"""A service with pool workers and users for the tests: what starts it, asks it and submits to it."""
import hashlib
import http.client
import json
import os
import time

import support
from support import measure

TOKEN = "the cluster's secret"


class ServiceTest(support.ClusterTest):
    USERS = {"ann": {}, "bob": {"share": 2}, "root": {"admin": True, "priority_limit": 5}}
    API = "127.0.0.1"  # where it listens for users
    SERVE = ("--log-level", "info")  # options of the service
    PREFIX = ()  # commands that become the service, or a worker

    def setUp(self):
        super().setUp()
        os.environ["CLOUDRENDERER_TOKEN"] = TOKEN
        self.addCleanup(os.environ.pop, "CLOUDRENDERER_TOKEN", None)
        self.pool_port, self.api_port = support.free_ports(2)
        users = [{"name": n, "token_sha256": hashlib.sha256(f"{n}'s token".encode()).hexdigest(), **more} for n, more in self.USERS.items()]
        (self.folder / "users.json").write_text(json.dumps({"users": users}))
        (self.folder / "prices.json").write_text(json.dumps({"currency": "EUR", "other": 3600}))
        for name in self.USERS:
            (self.folder / f"{name}.token").write_text(f"{name}'s token\n")

    def tearDown(self):
        for folder in (self.folder / "data").rglob("*"):  # scenes are read-only folders
            if folder.is_dir() and not folder.is_symlink():
                folder.chmod(0o755)

    def serve(self, workers=2, memory="64MiB"):
        self.start_service("service")
        for i in range(workers):
            self.start_worker(f"worker{i}", self.pool_port, 0, memory)
        self.wait_for(lambda: len(self.ask("root", "GET", "/v1/hosts")[1]) == workers, "the workers do not come")

    def start_service(self, name):
        self.service = self.start(name, "manager", "--serve", self.folder / "data", "--listen", f"127.0.0.1:{self.pool_port}", "--api",
                                  f"{self.API}:{self.api_port}", "--users", self.folder / "users.json", "--prices", self.folder / "prices.json",
                                  *self.SERVE, prefix=self.PREFIX)
        self.assertTrue(support.wait_until_listening(self.api_port), self.service.text())

    def start_worker(self, name, manager_port, port, memory, *options):
        return self.start(name, "worker", "--manager", f"127.0.0.1:{manager_port}", "--threads", 1, "--memory", memory, "--name", name, *options)

    def wait_for(self, condition, complaint, seconds=60):
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, f"{complaint}\n{self.logs()}")
            time.sleep(0.1)

    def ask(self, user, method, path, body=None, headers=None):
        """The status and the answer: JSON where it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.api_port, timeout=30)
        try:
            given = {"Authorization": f"Bearer {user}'s token"} if user else {}
            data = json.dumps(body) if isinstance(body, (dict, list)) else body
            connection.request(method, path, data, given | (headers or {}))
            answer = connection.getresponse()
            content = answer.read()
            return answer.status, json.loads(content) if answer.getheader("Content-Type", "").startswith("application/json") and content else content
        finally:
            connection.close()

    def command(self, user, *arguments, code=0):
        result = measure.run([support.PROGRAM, arguments[0], "--service", f"http://127.0.0.1:{self.api_port}", "--user-token-file",
                              self.folder / f"{user}.token", *arguments[1:]], timeout=120)
        self.assertEqual(result.code, code, f"{arguments}: {result.output}\n{self.logs()}")
        return result.output

    def submit(self, user, *arguments):
        return int(self.command(user, "submit", "--quiet", "--check", 0, *arguments).split()[-1])

    def state(self, user, job):
        return self.ask(user, "GET", f"/v1/jobs/{job}")[1]

    def wait_for_end(self, user, job, wanted="done", seconds=60):
        self.wait_for(lambda: self.state(user, job)["state"] in ("done", "failed", "cancelled", "paused"), f"job {job} does not end", seconds)
        state = self.state(user, job)
        self.assertEqual(state["state"], wanted, f"{state}\n{self.logs()}")
        return state

    def picture(self, user, job, frame=0):
        status, content = self.ask(user, "GET", f"/v1/jobs/{job}/frames/{frame}/picture.exr")
        self.assertEqual(status, 200, content)
        path = self.folder / f"got-{job}-{frame}.exr"
        path.write_bytes(content)
        return measure.read_rgb(path)

    def reference(self, name, scene, *options):
        out = self.folder / f"{name}.exr"
        result = measure.run([support.PROGRAM, "render", scene, "-o", out, "--quiet", *options], timeout=100)
        self.assertEqual(result.code, 0, result.output)
        return measure.read_rgb(out)

    def write(self, name, text):
        path = self.folder / "scenes" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path
