"""Every connection goes through a proxy that delays, resets and alters; the picture is that of an undisturbed render."""
import numpy as np
import support
from proxy import Proxy
from support import measure

SIZE, SPP = "128x128", 64
WORKERS = 4


class BadNetwork(support.ClusterTest):
    def check(self, proxy, *options):
        scene = self.split(part_size="300KiB")
        job = ("--spp", SPP, "--resolution", SIZE)
        wanted, report = self.render("wanted", scene, *job, "--threads", 2)
        memory = int(report["hosts"][0]["memory_peak"] * 0.7)  # of a host that holds everything
        ports = support.free_ports(2 * (WORKERS + 1))
        inner, outer = ports[:WORKERS + 1], ports[WORKERS + 1:]
        out = self.folder / "out.exr"
        with proxy:
            for a, b in zip(outer, inner):
                proxy.forward(a, b)
            manager = self.start_manager(scene, out, inner[0], *job, "--min-hosts", WORKERS, "--quiet", *options)
            for k in range(1, WORKERS + 1):
                self.start_worker(f"worker{k}", outer[0], inner[k], memory, "--advertise", f"127.0.0.1:{outer[k]}", *options)
            code = manager.wait(150)
            told = (f"seed {self.seed}: {proxy.connections} connections, {proxy.bytes} bytes, {proxy.flips} flips, "
                    f"{proxy.resets} resets")
            self.assertEqual(code, 0, f"{told}\n{self.logs()}")
            for worker in self.processes[1:]:
                # The last word of the manager may have been lost with its connection.
                self.assertIn(worker.wait(60), (0, 4), f"{told}\n{self.logs()}")
        print(told, flush=True)
        self.assertTrue(np.array_equal(measure.read_rgb(out), wanted), f"the picture differs: {told}\n{self.logs()}")
        self.assertGreater(proxy.connections, WORKERS, "no worker has called another one")
        self.assert_none_left()

    def proxy(self, seed, **faults):
        self.seed = seed
        return Proxy(seed, **faults)

    def test_50_ms_of_delay(self):
        self.check(self.proxy(1, delay=0.05))

    def test_resets(self):
        proxy = self.proxy(2, seconds_to_reset=1.5)
        self.check(proxy)
        self.assertGreater(proxy.resets, 0)

    def test_flipped_bits(self):
        proxy = self.proxy(3, bytes_to_flip=1 << 20)
        self.check(proxy)
        self.assertGreater(proxy.flips, 0)

    def test_all_of_it_encrypted(self):
        proxy = self.proxy(4, delay=0.02, bytes_to_flip=1 << 21, seconds_to_reset=3)
        self.check(proxy, "--tls", "on")
        self.assertGreater(proxy.flips + proxy.resets, 0)


if __name__ == "__main__":
    support.main()
