"""The Slurm batch script on four nodes: the picture of one host, exit codes, and going on after a job that was ended.

Needs root, Slurm and munge; skipped otherwise."""
import json
import os
import re
import sys

import numpy as np
import slurm_farm
import support
from support import measure

SCRIPT = support.ROOT / "docker" / "slurm" / "render.sbatch"
SIZE = "160x160"
FRAME = 8  # seconds that two undisturbed processors need at least


class Slurm(support.ClusterTest):
    known = {}  # sample count and wanted picture

    def setUp(self):
        super().setUp()
        if not self.known:
            spp = self.spp_for_frame(FRAME, support.SCENE, SIZE)
            image, _ = self.render("wanted", support.SCENE, "--spp", spp, "--resolution", SIZE, "--threads", 2, timeout=300)
            self.known.update(spp=spp, wanted=image)
        self.jobs = self.folder / "jobs"
        self.jobs.mkdir()
        self.out = self.jobs / "out.exr"
        folder = self.folder / "slurm"
        folder.mkdir()
        self.farm = slurm_farm.Farm(folder, {support.MARK: self.mark, "CLOUDRENDERER": str(support.PROGRAM.resolve())})
        self.addCleanup(self.farm.end)

    def submit(self, nodes, scene=support.SCENE, options=()):
        """The id of a job that renders."""
        said = self.farm.output("sbatch", f"--chdir={self.jobs}", f"--output={self.jobs}/slurm-%j.out", f"--nodes={nodes}",
                                SCRIPT, scene, self.out, "--spp", self.known["spp"], "--resolution", SIZE, "--part-size",
                                "300KiB", *options)
        found = re.search(r"Submitted batch job (\d+)", said)
        self.assertTrue(found, said)
        return found[1]

    def job(self, job):
        return dict(re.findall(r"(\w+)=(\S+)", self.farm.output("scontrol", "show", "job", job)))

    def finish(self, job, seconds=180):
        """The exit code of the job."""
        self.farm.wait(f"job {job} ends", lambda: self.job(job)["JobState"] not in ("PENDING", "CONFIGURING", "RUNNING",
                                                                                   "COMPLETING"), seconds)
        self.assertFalse((self.job_folder(job) / "token").exists(), "the secret was left behind")
        return int(self.job(job)["ExitCode"].partition(":")[0])

    def job_folder(self, job):
        return self.jobs / f"cloudrenderer-{job}"

    def texts(self, job):
        logs = [self.jobs / f"slurm-{job}.out", *sorted(self.job_folder(job).glob("*.log"))]
        return "\n".join(f"--- {p.name}\n{p.read_text(errors='replace')[-3000:]}" for p in logs if p.exists())

    def assert_picture(self, job, nodes):
        self.assertTrue(np.array_equal(measure.read_rgb(self.out), self.known["wanted"]), "the picture differs from one host's")
        report = json.loads((self.job_folder(job) / "report.json").read_text())
        self.assertEqual([h["name"] for h in report["hosts"] if h["lost"]], [])
        self.assertEqual(len(report["hosts"]), nodes, self.texts(job))
        self.assertEqual([h["threads"] for h in report["hosts"]], [1] * nodes, "not the processors that Slurm gave")

    def end(self):
        self.farm.end()
        self.assert_none_left()

    def test_four_nodes_and_one_make_the_picture_of_one_host(self):
        for nodes in (slurm_farm.NODES, 1):
            job = self.submit(nodes)
            self.assertEqual(self.finish(job), 0, self.texts(job))
            self.assert_picture(job, nodes)
            self.out.unlink()
            self.out.with_suffix(".ckpt").unlink()
        self.end()

    def test_a_job_that_is_told_to_end_goes_on_when_it_is_submitted_again(self):
        job = self.submit(slurm_farm.NODES)
        checkpoint = self.out.with_suffix(".ckpt")
        # The header is there at the start; more is what has been rendered.
        self.farm.wait("something is rendered", lambda: checkpoint.exists() and checkpoint.stat().st_size > 4096)
        self.farm.output("scancel", "--signal=TERM", job)  # what --signal and preemption send
        self.assertEqual(self.finish(job), 5, self.texts(job))
        self.assertTrue(self.out.exists(), "no picture of what there was")
        again = self.submit(3)
        self.assertEqual(self.finish(again), 0, self.texts(again))
        self.assert_picture(again, 3)
        first, second = (json.loads((self.job_folder(j) / "report.json").read_text())["rays"]["camera"] for j in (job, again))
        self.assertGreater(first, 0)
        self.assertLess(second, self.known["spp"] * 160 * 160, "all of it was rendered again")
        self.end()

    def test_the_exit_code_of_the_job_is_the_managers(self):
        scene = self.folder / "broken.pbrt"
        scene.write_text('WorldBegin\nShape "trianglemesh" "point P" [0 0 0]\nWorldEnd\n')
        job = self.submit(2, scene)
        self.assertEqual(self.finish(job), 3, self.texts(job))
        self.assertIn("broken.pbrt:2", (self.jobs / f"slurm-{job}.out").read_text())
        wrong = self.submit(2, options=["--replication", "none"])
        self.assertEqual(self.finish(wrong), 2, self.texts(wrong))
        self.end()

    def test_a_service_gets_its_hosts_as_tasks_of_arrays(self):
        """tools/scale_hosts.py submits docker/slurm/worker.sbatch as hosts are wanted, and ends the tasks when they are not."""
        farm, api, picture = self.farm, "http://127.0.0.1:8080", self.folder / "pictures" / f"{support.SCENE.stem}.exr"
        (self.folder / "token").write_text("of the test\n")
        (self.folder / "token").chmod(0o600)
        farm.environment |= {"CLOUDRENDERER_TOKEN_FILE": str(self.folder / "token"), "CLOUDRENDERER_SERVICE": api, "CLOUDRENDERER_USER_TOKEN": "of the test"}
        program, manager = support.PROGRAM.resolve(), f"{slurm_farm.ADDRESS}:7000"
        farm.daemon(program, "manager", "--serve", self.folder / "data", "--listen", manager, "--api", api.removeprefix("http://"), "--token-file",
                    self.folder / "token", "--min-hosts", 0, "--max-hosts", slurm_farm.NODES, "--host-start", 1, "--host-worth", 0.5, "--host-idle", 2, name="service")
        farm.wait("the service answers", lambda: "nothing to do" in farm.output(program, "status", "--hosts"))
        farm.daemon(sys.executable, support.ROOT / "tools" / "scale_hosts.py", "slurm", "--manager", manager, "--every", 0.5,
                    f"--output={self.folder}/worker-%A-%a.log", name="scaler")
        farm.output(program, "submit", "--quiet", support.SCENE, "--spp", self.known["spp"], "--resolution", SIZE, "--part-size", "300KiB")
        there = lambda n: f"{slurm_farm.NODES if n else 0} wanted, {n} there" in farm.output(program, "status", "--hosts")  # noqa: E731
        farm.wait("all nodes are hosts", lambda: there(slurm_farm.NODES))
        farm.wait("the job is done", lambda: " done " in farm.output(program, "status"), 180)
        farm.wait("the hosts have gone", lambda: there(0))
        farm.wait("Slurm has no tasks", lambda: not farm.output("squeue", "--noheader").strip())
        farm.output(program, "fetch", 1, "-o", picture.parent)
        self.assertTrue(np.array_equal(measure.read_rgb(picture), self.known["wanted"]), "the picture differs from one host's")
        ends = {self.job(task)["ExitCode"] for task in re.findall(r"JobId=(\d+)", farm.output("scontrol", "show", "job"))}
        self.assertEqual(ends, {"0:0"}, farm.logs())
        self.end()


if __name__ == "__main__":
    reason = slurm_farm.why_not()
    if reason:
        print(f"SKIPPED: {reason}")
        sys.exit(measure.SKIPPED)
    support.main()
