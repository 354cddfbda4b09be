"""The image and the compose file with a real Docker daemon: five workers make the picture of one host while one is stopped.

Needs root, Docker, docker-compose and debootstrap; skipped otherwise. The image is built, which takes many minutes;
`build/docker-test` keeps the steps whose input has not changed."""
import json
import os
import shutil
import sys
import time

import docker_daemon
import numpy as np
import support
from support import measure

COMPOSE = support.ROOT / "docker" / "compose.yml"
SCENE = support.ROOT / "scenes" / "killeroo" / "killeroo-demo.pbrt"
SIZE = "160x160"
WORKERS = 5
FRAME = 15  # seconds that two undisturbed processors need at least
USER = 1000


class Compose(support.ClusterTest):
    built = False
    known = {}  # sample count and wanted picture

    def setUp(self):
        super().setUp()
        if not self.known:
            docker_daemon.build_image()
            spp = self.spp_for_frame(FRAME, SCENE, SIZE)
            image, _ = self.render("wanted", SCENE, "--spp", spp, "--resolution", SIZE, "--threads", 2, timeout=300)
            self.known.update(spp=spp, wanted=image)
        self.daemon = docker_daemon.Daemon(host_network=False)
        self.addCleanup(self.daemon.end)
        # The file as it is, in a folder of its own: the picture must not come into the sources.
        self.project = self.folder / "docker"
        self.project.mkdir()
        shutil.copy(COMPOSE, self.project)
        self.out = self.project / "out"
        self.out.mkdir()
        os.chown(self.out, USER, USER)
        self.folder.chmod(0o711)
        self.settings = {"CLOUDRENDERER_TOKEN": "of the compose test",
                         "OPTIONS": f"--resolution {SIZE} --spp {self.known['spp']} --quiet"}

    def compose(self, *arguments, check=True, timeout=240, **settings):
        return self.daemon.run("docker-compose", "-f", self.project / "compose.yml", *arguments, check=check,
                               timeout=timeout, env=self.settings | settings)

    def container(self, service, number=1):
        return f"docker_{service}_{number}"

    def state(self, container):
        return json.loads(self.daemon.run("docker", "inspect", "-f", "{{json .State}}", container).stdout)

    def wait(self, what, condition, seconds=120):
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, f"never: {what}\n{self.compose('logs', check=False).stdout[-6000:]}")
            time.sleep(0.2)

    def report(self):
        return json.loads((self.out / "report.json").read_text())

    def assert_picture(self):
        self.assertTrue(np.array_equal(measure.read_rgb(self.out / "killeroo.exr"), self.known["wanted"]),
                        "the picture differs from one host's")
        self.assertEqual((self.out / "killeroo.exr").stat().st_uid, USER)

    def test_five_workers_one_of_which_is_stopped(self):
        self.compose("up", "-d", "--no-build", "--scale", f"worker={WORKERS}", MIN_HOSTS=str(WORKERS))
        manager, stopped = self.container("manager"), self.container("worker", 3)
        self.assertEqual(self.daemon.run("docker", "exec", stopped, "id", "-u").stdout.strip(), str(USER))
        self.wait("a worker computes", lambda: self.seconds_of_processor(stopped) > 2)
        start = time.monotonic()
        self.daemon.run("docker", "stop", "--time", 60, stopped)
        took = time.monotonic() - start
        self.assertTrue(self.state(manager)["Running"], "the frame had ended before the stop")
        self.assertEqual(self.state(stopped)["ExitCode"], 0, self.daemon.run("docker", "logs", stopped).stdout)
        self.assertLess(took, 30)
        everybody = [manager, *(self.container("worker", k) for k in range(1, 1 + WORKERS))]
        self.wait("all containers end with the frame", lambda: not any(self.state(c)["Running"] for c in everybody))
        self.assertEqual([self.state(c)["ExitCode"] for c in everybody], [0] * len(everybody),
                         self.compose("logs", check=False).stdout[-6000:])
        self.assert_picture()
        report = self.report()
        self.assertEqual(len(report["hosts"]), WORKERS)
        self.assertEqual([h["name"] for h in report["hosts"] if h["lost"]], [])
        self.assertEqual(len([h for h in report["hosts"] if h["left_s"] is not None and h["left_s"] < report["time"]["wall_s"] - 1]),
                         1, report["hosts"])
        # Not nothing: at the end of the frame two hosts may make the same.
        self.assertLess(report["wasted_paths"], 0.01 * report["paths"])
        for host in report["hosts"]:  # of the container's limit
            self.assertAlmostEqual(host["memory_budget"], 0.8 * 2 * 1024**3, delta=4096)
        self.compose("down")
        print(f"image {self.image_size()} MB; docker stop of a worker took {took:.1f} s; "
              f"{report['time']['render_s']:.1f} s to render, {report['wasted_paths']} of {report['paths']} paths wasted", flush=True)

    def seconds_of_processor(self, container):
        inside = "cut -d' ' -f14,15 /proc/1/stat"
        return sum(map(int, self.daemon.run("docker", "exec", container, "sh", "-c", inside).stdout.split())) / os.sysconf("SC_CLK_TCK")

    def image_size(self):
        return int(self.daemon.run("docker", "image", "inspect", "-f", "{{.Size}}", docker_daemon.IMAGE).stdout) // 10**6

    def test_the_exit_code_of_the_manager_is_that_of_compose(self):
        done = self.compose("up", "--no-build", "--scale", "worker=2", "--exit-code-from", "manager", check=False,
                            OPTIONS=f"--resolution {SIZE} --spp 16 --quiet")
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertTrue((self.out / "killeroo.exr").exists())
        self.compose("down")
        missing = self.compose("up", "--no-build", "--scale", "worker=2", "--exit-code-from", "manager", check=False,
                               SCENE="/out/missing.pbrt")
        self.assertNotEqual(missing.returncode, 0, missing.stdout)
        self.assertEqual(self.state(self.container("manager"))["ExitCode"], 3, missing.stdout)
        self.compose("down")

    def test_without_a_secret_nothing_starts(self):
        del self.settings["CLOUDRENDERER_TOKEN"]
        self.daemon.environment.pop("CLOUDRENDERER_TOKEN", None)
        refused = self.compose("config", check=False)
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn("CLOUDRENDERER_TOKEN", refused.stdout)


if __name__ == "__main__":
    reason = docker_daemon.why_not()
    if reason:
        print(f"SKIPPED: {reason}")
        sys.exit(measure.SKIPPED)
    support.main()
