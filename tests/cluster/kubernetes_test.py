"""The Kubernetes files: against the schemas of Kubernetes, against each other, and their command lines in real processes.

The schemas come with `kubernetes-validate` from PyPI, in a virtual environment under build/; without it, skipped."""
import hashlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request

import numpy as np
import support
from support import measure

FOLDER = support.ROOT / "docker" / "kubernetes"
VENV = support.ROOT / "build" / "kubernetes-venv"
PYTHON = VENV / "bin" / "python"
CHECKER = [PYTHON, "-m", "kubernetes_validate"]
VERSIONS = ("1.29", None)  # the oldest that takes all of it as it is, and the newest that the checker knows
SIZE = "64x64"


def why_not():
    """Why it cannot run here, or None."""
    if PYTHON.exists() and subprocess.run([*CHECKER, "--version"], capture_output=True, timeout=60).returncode == 0:
        return None
    for command in ([sys.executable, "-m", "venv", VENV], [PYTHON, "-m", "pip", "install", "-q", "kubernetes-validate"]):
        made = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300)
        if made.returncode != 0:
            shutil.rmtree(VENV, ignore_errors=True)
            return f"no kubernetes-validate (PyPI, and Debian's python3-venv): {made.stdout[-300:].strip()}"
    return None


def documents(text):
    """The objects of a YAML text. The checker's environment has a parser, this one may not."""
    script = "import json, sys, yaml; json.dump(list(yaml.safe_load_all(sys.stdin)), sys.stdout)"
    return json.loads(subprocess.run([PYTHON, "-c", script], input=text, stdout=subprocess.PIPE, text=True,
                                     check=True).stdout)


def validate(path, version=None):
    command = [*CHECKER, "--strict", *(["-k", version] if version else []), path]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)


def files():
    return sorted(p for p in FOLDER.glob("*.yaml") if p.name != "kustomization.yaml")


class Schema(support.ClusterTest):
    def assert_valid(self, path):
        for version in VERSIONS:
            result = validate(path, version)
            self.assertEqual(result.returncode, 0, result.stdout)
            self.assertIn("passed", result.stdout)

    def test_every_file_keeps_to_the_schemas(self):
        self.assertGreater(len(files()), 0)
        for path in files():
            self.assert_valid(path)

    def test_the_checker_finds_what_is_wrong(self):
        wrong = self.folder / "wrong.yaml"
        for path, good, bad in ((FOLDER / "workers.yaml", "minReplicas:", "minimumReplicas:"),
                                (FOLDER / "manager.yaml", "backoffLimit: 6", "backoffLimit: six")):
            text = path.read_text()
            self.assertIn(good, text)
            wrong.write_text(text.replace(good, bad))
            self.assertNotEqual(validate(wrong).returncode, 0, bad)

    def test_what_kustomize_makes_of_them(self):
        if shutil.which("kubectl") is None:
            self.skipTest("no kubectl")
        copy = self.folder / "kubernetes"
        shutil.copytree(FOLDER, copy)
        (copy / "token").write_text("secret\n")
        made = subprocess.run(["kubectl", "kustomize", copy], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual(made.returncode, 0, made.stderr)
        whole = self.folder / "whole.yaml"
        whole.write_text(made.stdout)
        self.assert_valid(whole)
        kinds = sorted(d["kind"] for d in documents(made.stdout))
        self.assertEqual(kinds, sorted([d["kind"] for d in self.objects().values()] + ["Secret"]))

    def objects(self):
        found = [d for path in files() for d in documents(path.read_text())]
        return {(d["kind"], d["metadata"]["name"]): d for d in found}

    def test_names_that_one_object_gives_another_exist(self):
        objects = self.objects()
        kustomization, = documents((FOLDER / "kustomization.yaml").read_text())
        self.assertEqual(sorted(kustomization["resources"]), [p.name for p in files()])
        secrets = {s["name"] for s in kustomization["secretGenerator"]}
        images = {i["name"] for i in kustomization["images"]}
        pods = {name: d["spec"]["template"] for (_, name), d in objects.items() if "template" in d["spec"]}
        self.assertEqual(len(pods), 2)
        for pod in pods.values():
            container, = pod["spec"]["containers"]
            self.assertIn(container["image"], images)
            volumes = {v["name"]: v for v in pod["spec"]["volumes"]}
            self.assertEqual({m["name"] for m in container["volumeMounts"]}, set(volumes))
            self.assertIn(volumes["secret"]["secret"]["secretName"], secrets)
            if "data" in volumes:
                self.assertIn(("PersistentVolumeClaim", volumes["data"]["persistentVolumeClaim"]["claimName"]), objects)
        service, = (d for (kind, _), d in objects.items() if kind == "Service")
        chosen = [pod for pod in pods.values() if service["spec"]["selector"].items() <= pod["metadata"]["labels"].items()]
        self.assertEqual(len(chosen), 1, "the service must lead to the manager alone")
        port, = service["spec"]["ports"]
        self.assertIn(port["targetPort"], [p["name"] for p in chosen[0]["spec"]["containers"][0]["ports"]])
        workers, = (d for (kind, _), d in objects.items() if kind == "Deployment")
        self.assertLessEqual(workers["spec"]["selector"]["matchLabels"].items(),
                             workers["spec"]["template"]["metadata"]["labels"].items())
        self.assertIn(f"--manager {service['metadata']['name']}:{port['port']} ", self.container(workers)["args"][0])
        scaler, = (d for (kind, _), d in objects.items() if kind == "HorizontalPodAutoscaler")
        target = scaler["spec"]["scaleTargetRef"]
        self.assertEqual(objects[target["kind"], target["name"]]["apiVersion"], target["apiVersion"])
        manager, = (d for (kind, _), d in objects.items() if kind == "Job")
        minimum, = (int(a.partition("=")[2]) for a in self.container(manager)["args"] if a.startswith("--min-hosts="))
        self.assertGreaterEqual(scaler["spec"]["minReplicas"], minimum, "the frame would never begin")

    def container(self, owner):
        return owner["spec"]["template"]["spec"]["containers"][0]

    def test_their_command_lines_render_the_scene(self):
        """The arguments as they stand in the files; only folders, addresses and the picture's size are of this test."""
        objects = self.objects()
        manager, = (self.container(d) for (kind, _), d in objects.items() if kind == "Job")
        worker, = (self.container(d) for (kind, _), d in objects.items() if kind == "Deployment")
        ports = support.free_ports(3)
        (self.folder / "token").write_text("of the test\n")
        size = ("--resolution", SIZE, "--spp", 4)
        scene, = (a for a in manager["args"] if a.startswith("/scenes"))
        wanted, _ = self.render("wanted", str(support.ROOT) + scene, *size)

        def here(text, port=None):
            for there, ours in (("/scenes/", f"{support.ROOT}/scenes/"), ("/data/", f"{self.folder}/"),
                                ("/secret/", f"{self.folder}/"), ("=0.0.0.0:7000", f"=127.0.0.1:{ports[0]}"),
                                ("cloudrenderer-manager:7000", f"127.0.0.1:{ports[0]}"), (":7001", f":{port}")):
                text = text.replace(there, ours)
            return text

        self.start("manager", *(here(a) for a in manager["args"]), *size, "--quiet")
        limits = worker["resources"]["limits"]
        memory = int(limits["memory"].removesuffix("Gi")) * 2**30
        values = {"MEMORY_LIMIT": memory, "CPU_LIMIT": int(limits["cpu"]), "POD_IP": "127.0.0.1"}
        self.assertEqual({e["name"] for e in worker["env"]}, {*values, "POD_NAME"})
        self.assertEqual(worker["command"], ["sh", "-c"])
        line, = worker["args"]
        self.assertEqual(re.findall(r"(?<!\$)\$\(\w+\)", line), [])
        line = line.replace("$$", "$")  # as the kubelet does it
        path = f"PATH={support.PROGRAM.resolve().parent}:/usr/bin:/bin"
        for k in (1, 2):
            environment = ["env", path, f"POD_NAME=worker-{k}", *(f"{name}={v}" for name, v in values.items())]
            # Process puts the program behind the prefix: there it is the shell's $0.
            self.start(f"worker{k}", prefix=[*environment, *worker["command"], here(line, ports[k])])
        for process in self.processes:
            self.assertEqual(process.wait(120), 0, self.logs())
        self.assert_none_left()
        self.assertTrue(np.array_equal(measure.read_rgb(self.folder / "killeroo.exr"), wanted), "the picture differs")
        report = json.loads((self.folder / "killeroo.json").read_text())
        self.assertEqual(sorted((h["name"], h["memory_budget"], h["threads"]) for h in report["hosts"]),
                         [(f"worker-{k}", memory // 5 * 4, 2) for k in (1, 2)])


class ServiceFiles(support.ClusterTest):
    """The service whose workers come and go as it wants them. KEDA's own objects have no schema here: what they name is checked."""
    FOLDER = FOLDER / "service"

    def objects(self):
        found = [d for name in ("service", "workers", "scaler") for d in documents((self.FOLDER / f"{name}.yaml").read_text())]
        return {(d["kind"], d["metadata"]["name"]): d for d in found}

    def of_kind(self, kind):
        found, = (d for (k, _), d in self.objects().items() if k == kind)
        return found

    def container(self, kind):
        found, = self.of_kind(kind)["spec"]["template"]["spec"]["containers"]
        return found

    def option(self, name):
        return next(a.partition("=")[2] for a in self.container("StatefulSet")["args"] if a.startswith(f"--{name}="))

    def test_kubernetes_takes_what_is_its_own(self):
        for name in "service", "workers":
            for version in VERSIONS:
                result = validate(self.FOLDER / f"{name}.yaml", version)
                self.assertEqual(result.returncode, 0, result.stdout)

    def test_names_that_one_object_gives_another_exist(self):
        kustomization, = documents((self.FOLDER / "kustomization.yaml").read_text())
        self.assertEqual(sorted(kustomization["resources"]), sorted(p.name for p in self.FOLDER.glob("*.yaml") if p.name != "kustomization.yaml"))
        self.assertTrue(kustomization["generatorOptions"]["disableNameSuffixHash"])
        secrets = {s["name"]: [f.partition("=")[0] for f in s["files"]] for s in kustomization["secretGenerator"]}
        maps = {m["name"] for m in kustomization["configMapGenerator"]}
        for kind in "StatefulSet", "Deployment":
            spec = self.of_kind(kind)["spec"]
            pod = spec["template"]
            self.assertLessEqual(spec["selector"]["matchLabels"].items(), pod["metadata"]["labels"].items())
            volumes = {v["name"]: v for v in [*pod["spec"]["volumes"], *({"name": c["metadata"]["name"]} for c in spec.get("volumeClaimTemplates", []))]}
            self.assertEqual({m["name"] for m in self.container(kind)["volumeMounts"]}, set(volumes))
            for volume in volumes.values():
                self.assertIn(volume.get("secret", {}).get("secretName", "cloudrenderer-token"), secrets)
                self.assertIn(volume.get("configMap", {}).get("name", "cloudrenderer-prices"), maps)
        service = self.of_kind("Service")
        self.assertEqual(service["spec"]["clusterIP"], "None", "frames' managers listen on ports of their own")
        self.assertLessEqual(service["spec"]["selector"].items(), self.of_kind("StatefulSet")["spec"]["template"]["metadata"]["labels"].items())
        self.assertEqual(self.of_kind("StatefulSet")["spec"]["serviceName"], service["metadata"]["name"])
        ports = {p["name"]: p["port"] for p in service["spec"]["ports"]}
        self.assertEqual(self.option("advertise"), service["metadata"]["name"])
        self.assertIn(f"--manager {service['metadata']['name']}:{ports['cluster']} ", self.container("Deployment")["args"][0])
        scaled = self.of_kind("ScaledObject")["spec"]
        self.assertEqual(scaled["scaleTargetRef"], {"apiVersion": "apps/v1", "kind": "Deployment", "name": self.of_kind("Deployment")["metadata"]["name"]})
        trigger, = scaled["triggers"]
        self.assertEqual(trigger["metadata"]["url"], f"https://{service['metadata']['name']}:{ports['api']}/v1/hosts/wanted")
        self.assertEqual((trigger["type"], trigger["metricType"], trigger["metadata"]["targetValue"]), ("metrics-api", "AverageValue", "1"))
        login = self.of_kind("TriggerAuthentication")
        self.assertEqual(trigger["authenticationRef"]["name"], login["metadata"]["name"])
        reference, = login["spec"]["secretTargetRef"]
        self.assertEqual((trigger["metadata"]["authMode"], reference["parameter"]), ("bearer", "token"))
        self.assertIn(reference["key"], secrets[reference["name"]])
        kind, = support.json_of(self.FOLDER / "prices.json")["kinds"].items()
        self.assertEqual(trigger["metadata"]["valueLocation"], f'kinds.#(kind=="{kind[0]}").wanted')
        self.assertIn(f" --kind {kind[0]} ", self.container("Deployment")["args"][0].replace("\n", " ") + " ")
        limits = self.container("Deployment")["resources"]["limits"]
        self.assertEqual(kind[1]["threads"], int(limits["cpu"]))
        self.assertAlmostEqual(kind[1]["memory_gib"], int(limits["memory"].removesuffix("Gi")) * 4 / 5, delta=0.01)
        self.assertEqual({kind[1]["max"], int(self.option("max-hosts"))}, {scaled["maxReplicaCount"]})
        self.assertEqual(int(self.option("min-hosts")), scaled["minReplicaCount"])

    def test_their_command_lines_serve_what_the_scaler_reads(self):
        """The arguments as they stand in the files; only folders and addresses are of this test."""
        cluster, api = support.free_ports(2)
        (self.folder / "token").write_text("of the test\n")
        digest = hashlib.sha256(b"scaler's").hexdigest()
        (self.folder / "users.json").write_text(json.dumps({"users": [{"name": "scaler", "token_sha256": digest, "jobs": 0}]}))

        def here(text):
            for there, ours in (("/data/", f"{self.folder}/data/"), ("/secret/", f"{self.folder}/"), ("/users/", f"{self.folder}/"),
                                ("/prices/", f"{self.FOLDER}/"), ("=0.0.0.0:7000", f"=127.0.0.1:{cluster}"), ("=0.0.0.0:8443", f"=127.0.0.1:{api}"),
                                ("--advertise=cloudrenderer-service", "--advertise=127.0.0.1"), ("cloudrenderer-service:7000", f"127.0.0.1:{cluster}")):
                text = text.replace(there, ours)
            return text

        service = self.start("service", *(here(a) for a in self.container("StatefulSet")["args"]))
        self.assertTrue(support.wait_until_listening(api), service.text())
        worker = self.container("Deployment")
        values = {"MEMORY_LIMIT": 2**30, "CPU_LIMIT": 2}
        self.assertEqual({e["name"] for e in worker["env"]}, {*values, "POD_NAME"})
        line, = worker["args"]
        path = f"PATH={support.PROGRAM.resolve().parent}:/usr/bin:/bin"
        self.start("worker", prefix=["env", path, "POD_NAME=pod-1", *(f"{k}={v}" for k, v in values.items()), *worker["command"], here(line.replace("$$", "$"))])
        request = urllib.request.Request(f"http://127.0.0.1:{api}/v1/hosts/wanted", headers={"Authorization": "Bearer scaler's"})
        end = time.monotonic() + 30
        while True:
            answer = json.load(urllib.request.urlopen(request, timeout=20))
            pods = [k for k in answer["kinds"] if k["kind"] == "pod"]
            if pods and pods[0]["there"] == 1:
                break
            self.assertLess(time.monotonic(), end, f"{answer}\n{self.logs()}")
            time.sleep(0.2)
        self.assertEqual([h["name"] for h in answer["hosts"]], ["pod-1"])
        self.assertEqual(pods[0]["wanted"], 1, "who has just come is kept for a while")
        self.processes[1].kill(signal.SIGTERM)
        self.assertEqual(self.processes[1].wait(20), 0, self.logs())


if __name__ == "__main__":
    reason = why_not()
    if reason:
        print(f"SKIPPED: {reason}")
        sys.exit(measure.SKIPPED)
    support.main()
