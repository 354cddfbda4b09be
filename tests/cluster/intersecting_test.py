"""Hosts that only intersect: they hold parts that nobody else holds, and segments are asked, not moved."""
import numpy as np
import support

SPP, SIZE = 4, "120x120"


class Intersecting(support.ClusterTest):
    def test_the_same_bits_as_one_host(self):
        split = self.split()
        wanted, one = self.render("one", split, "--threads", 1, "--spp", SPP, "--resolution", SIZE)
        manager_port, *ports = support.free_ports(4)
        out = self.folder / "asked.exr"
        manager = self.start_manager(split, out, manager_port, "--min-hosts", 3, "--spp", SPP, "--resolution", SIZE, "--quiet")
        # Less than one copy in the two that trace.
        share = int(one["hosts"][0]["memory_peak"] * 0.45)
        for i, port in enumerate(ports):
            self.start_worker(f"host{i}", manager_port, port, share, *(["--only-intersect"] if i == 2 else []))
        self.assertEqual(manager.wait(60), 0, self.logs())
        report = support.json_of(self.folder / "report.json")
        self.assertTrue(np.array_equal(support.measure.read_rgb(out), wanted), "the picture differs from one host's")
        self.assertTrue(report["bit_exact"])
        self.assertGreater(report["rays"]["nearest_asked"], 0)
        third = next(h for h in report["hosts"] if h["name"] == "host2")
        self.assertGreater(third["parts_loaded"], 0)
        self.assertGreater(third["tasks"]["intersection"], 0)
        self.assertEqual(third["tasks"]["tracer"] + third["tasks"]["renderer"] + third["tasks"]["aggregator"], 0)
        self.assertEqual(sum(h["paged_in"] for h in report["hosts"]), 0)


if __name__ == "__main__":
    support.main()
