"""The exit codes of the command line: 1 a bound missed, 2 wrong usage, 3 an unreadable scene, 4 no cluster."""
import support

TINY = ("--spp", "1", "--resolution", "16x16", "--quiet")


class ExitCodes(support.ClusterTest):
    def expect(self, code, *arguments, words=""):
        result = self.run_program(*arguments, timeout=60)
        self.assertEqual(result.code, code, f"{arguments}: {result.output}")
        if words:
            self.assertRegex(result.output, words)
        return result

    def broken(self, text):
        path = self.folder / "broken.pbrt"
        path.write_text(text)
        return path

    def test_0_for_what_works(self):
        out = self.folder / "a.exr"
        self.expect(0, "render", support.SCENE, "-o", out, *TINY)
        self.assertTrue(out.exists())
        self.expect(0, "info", support.SCENE, words=r"\w")
        self.expect(0, "--version", words=r"\d+\.\d+")
        self.expect(0, "--help", words="render")

    def test_1_when_pictures_differ_by_more_than_was_allowed(self):
        a, b = self.folder / "a.exr", self.folder / "b.exr"
        self.expect(0, "render", support.SCENE, "-o", a, *TINY)
        self.expect(0, "render", support.SCENE, "-o", b, *TINY, "--seed", "5")
        self.expect(0, "compare", a, a, "--max-relmse", "0", words="relmse")
        self.expect(1, "compare", a, b, "--max-relmse", "1e-9")

    def test_2_for_wrong_usage(self):
        self.expect(2)
        self.expect(2, "paint", words="(?i)paint|subcommand|command")
        self.expect(2, "render")
        self.expect(2, "render", support.SCENE, "--no-such-option", words="no-such-option")
        self.expect(2, "render", support.SCENE, "--hosts", "none")
        self.expect(2, "render", support.SCENE, "--memory", "12 parsecs", words="size")
        self.expect(2, "worker")

    def test_3_for_a_broken_scene_with_its_place(self):
        path = self.broken('WorldBegin\nShape "sphere" "float radius" [1 oops]\nWorldEnd\n')
        self.expect(3, "render", path, *TINY, words=r"broken\.pbrt:2:\d+: error: ")
        path = self.broken('LookAt 0 0 1\nWorldBegin\nWorldEnd\n')
        self.expect(3, "render", path, *TINY, words=r"broken\.pbrt:\d+:\d+: error: ")

    def test_3_for_a_scene_that_is_not_there(self):
        self.expect(3, "render", self.folder / "nowhere.pbrt", *TINY, words=r"nowhere\.pbrt")
        path = self.broken('WorldBegin\nInclude "nowhere.pbrt"\nWorldEnd\n')
        self.expect(3, "render", path, *TINY, words=r"broken\.pbrt:2:\d+: error: ")

    def test_4_without_workers(self):
        port = support.free_ports(1)[0]
        result = self.expect(4, "manager", support.SCENE, "-o", self.folder / "a.exr", *TINY, "--listen",
                             f"127.0.0.1:{port}", "--wait", "2")
        self.assertGreater(result.wall, 1.5, "it did not wait")
        self.assertLess(result.wall, 20)


if __name__ == "__main__":
    support.main()
