"""The exit codes of the command line: 1 a bound missed, 2 wrong usage, 3 an unreadable scene, 4 no cluster."""
import shlex
import shutil
import socket
import struct
import subprocess
import zlib

import support
import wire_support as wire

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

    def test_3_for_materials_that_make_no_picture(self):
        """Found before any host is asked, in a scene and in its split."""
        for material in ('Material "measured"', 'Material "measured" "string filename" "nowhere.brdf"'):
            path = self.broken(f'WorldBegin\n{material}\nShape "sphere"\nWorldEnd\n')
            self.expect(3, "render", path, *TINY, words=r"broken\.pbrt:2:\d+: error: .*(filename|nowhere)")
            self.expect(3, "info", path, words=r"broken\.pbrt:2:\d+: error: ")
            split = self.folder / "split"
            self.expect(0, "split", path, "-o", split)
            self.expect(3, "render", split, *TINY, words=r"broken\.pbrt:2:\d+: error: .*(filename|nowhere)")
            shutil.rmtree(split)
        # A surface in one colour is a picture, too, as in pbrt.
        path = self.broken('WorldBegin\nTexture "t" "color" "imagemap" Material "matte" "texture Kd" "t"\nShape "sphere"\nWorldEnd\n')
        self.expect(0, "render", path, "-o", self.folder / "a.exr", *TINY, words=r"broken\.pbrt:2:\d+: warning: .*filename.*white is used")

    def test_what_is_not_supported_is_told(self):
        path = self.broken('WorldBegin\nLightSource "infinite" "string mapname" "nowhere.exr"\n'
                           'Texture "t" "color" "ptex"\nMaterial "matte" "texture Kd" "t"\n'
                           'Shape "sphere"\nLightSource "laser"\nWorldEnd\n')
        for command in (("info", path), ("render", path, "-o", self.folder / "a.exr", *TINY)):
            output = self.expect(0, *command).output
            for words in (r"texture is not supported", r'light "laser" is not supported', r"the map .*nowhere\.exr"):
                self.assertRegex(output, words)

    def test_3_for_a_scene_that_is_not_there(self):
        self.expect(3, "render", self.folder / "nowhere.pbrt", *TINY, words=r"nowhere\.pbrt")
        path = self.broken('WorldBegin\nInclude "nowhere.pbrt"\nWorldEnd\n')
        self.expect(3, "render", path, *TINY, words=r"broken\.pbrt:2:\d+: error: ")

    def damaged(self, name, file, change):
        folder = self.folder / name
        shutil.copytree(self.folder / "split", folder)
        data = (folder / file).read_bytes()
        (folder / file).write_bytes(change(data))
        return folder

    def test_3_for_a_damaged_split(self):
        self.split()
        for name, file, words in (("manifest", "manifest.bin", r"manifest\.bin: manifest: "),
                                  ("part", "parts/00003.part", r"00003\.part: the file has \d+ bytes, \d+ belong")):
            cut = self.damaged(name, file, lambda data: data[:len(data) // 2])
            for hosts in (1, 2):
                self.expect(3, "render", cut, "-o", self.folder / "a.exr", *TINY, "--hosts", hosts, words=words)
            (cut / file).unlink()
            self.expect(3, "render", cut, "-o", self.folder / "a.exr", *TINY)

    def test_4_for_a_part_that_was_altered(self):
        self.split()
        altered = self.damaged("altered", "parts/00003.part",
                               lambda data: data[:3000] + bytes((data[3000] ^ 1,)) + data[3001:])
        for hosts in (1, 2):
            self.expect(4, "render", altered, "-o", self.folder / "a.exr", *TINY, "--hosts", hosts,
                        words=r"part 3: .*00003\.part: part: wrong checksum")
        self.assertFalse((self.folder / "a.exr").exists())

    def test_4_for_a_picture_that_no_host_can_read(self):
        """Four hundred million pixels in a file of half a megabyte: told, and no host is exhausted."""
        row = zlib.compress(bytes(1 + 20000 // 8) * 20000, 1)
        chunks = ((b"IHDR", struct.pack(">IIBBBBB", 20000, 20000, 1, 0, 0, 0, 0)), (b"IDAT", row), (b"IEND", b""))
        (self.folder / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks))
        for hosts, user in ((1, 'Texture "t" "color" "imagemap" "string filename" "huge.png" Material "matte" "texture Kd" "t" Shape "sphere"'),
                            (2, 'LightSource "infinite" "string mapname" "huge.png" Shape "sphere"')):
            path = self.broken(f"WorldBegin\n{user}\nWorldEnd\n")
            self.expect(4, "render", path, "-o", self.folder / "a.exr", *TINY, "--hosts", hosts, "--memory", "600MiB",
                        words=r"20000 x 20000 pixels of .*huge\.png takes \d+ MiB, and this host may use 600 MiB")

    def expect_full(self, blocks, words, *arguments):
        """With a disk that is full after so many KiB: a limit on the size of files stands for it."""
        program = shlex.join(map(str, (support.PROGRAM, *arguments)))
        result = subprocess.run(["bash", "-c", f"trap '' XFSZ; ulimit -f {blocks}; exec {program}"], timeout=60,
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 4, result.stderr)
        self.assertRegex(result.stderr, words)

    def test_4_for_a_full_disk(self):
        split = self.split()
        picture = ("--spp", "1", "--resolution", "64x64", "--quiet")
        # (Of .png the limit, unlike a disk, also stops the loading of what writes it.)
        for name in ("full.exr", "full.pfm", "full.png"):
            out = self.folder / name
            self.expect_full(1, rf"cannot write .*{name}: (OpenImageIO cannot be loaded: )?File too large", "render", split, "-o", out, *picture)
            self.assertFalse(out.exists(), "half a picture was left behind")
        self.expect_full(100, "split: File too large", "split", support.SCENE, "-o", self.folder / "full")
        self.assertFalse((self.folder / "full" / "manifest.bin").exists(), "a split that looks complete")
        self.expect(4, "render", split, "-o", self.folder / "a.exr", *TINY, "--report", "/dev/full",
                    words="cannot write the report /dev/full")

    def test_4_for_addresses_that_lead_nowhere(self):
        out = self.folder / "a.exr"
        with socket.create_server(("127.0.0.1", 0)) as taken:
            address = "127.0.0.1:%d" % taken.getsockname()[1]
            self.expect(4, "manager", support.SCENE, "-o", out, *TINY, "--listen", address,
                        words=f"cannot listen on {address}: Address already in use")
            port = support.free_ports(1)[0]
            manager = self.start_manager(support.SCENE, out, port, *TINY, "--wait", 30)
            worker = self.start("worker", "worker", "--manager", f"127.0.0.1:{port}", "--listen", address)
            self.assertEqual(worker.wait(20), 4, worker.text())
            self.assertIn(f"cannot listen on {address}: Address already in use", worker.text())
            manager.kill()
            manager.wait(10)
        self.expect(4, "worker", "--manager", address, "--wait", 1, words=f"cannot connect to {address}: Connection ref")
        nowhere = "nowhere.invalid:4000"
        self.expect(4, "worker", "--manager", nowhere, "--wait", 1, words=f"cannot connect to {nowhere}: Host not found")
        self.expect(4, "manager", support.SCENE, "-o", out, *TINY, "--listen", nowhere,
                    words=f"cannot listen on {nowhere}: Host not found")

    def test_4_for_a_worker_with_absurd_numbers(self):
        port = support.free_ports(1)[0]
        manager = self.start_manager(support.SCENE, self.folder / "a.exr", port, *TINY, "--wait", 30)
        absurd = self.start_worker("absurd", port, 0, "1048576TiB")
        self.assertEqual(absurd.wait(20), 4, absurd.text())
        self.assertRegex(absurd.text(), "the manager refuses this host: .*1048576 TiB of memory; up to 1024 TiB")
        self.assertTrue(manager.running(), manager.text())
        self.assertEqual(self.start_worker("worker", port, 0, "512MiB").wait(30), 0, self.logs())
        self.assertEqual(manager.wait(10), 0, manager.text())
        self.assertIn("1048576 TiB", manager.text())

    def test_4_for_another_protocol_version(self):
        """A manager of a later version, which is only said by its first frame."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.settimeout(1)
            port = server.getsockname()[1]
            worker = self.start("worker", "worker", "--manager", f"127.0.0.1:{port}", "--wait", 3)
            peers = []
            try:
                for _ in range(20):  # it introduces itself more than once
                    try:
                        peers.append(wire.Peer(server.accept()[0]))
                    except TimeoutError:
                        if not worker.running():
                            break
                        continue
                    peers[-1].send(wire.frame(wire.payload(wire.CHALLENGE, wire.field(1, b"n" * 32), version=3)))
                self.assertEqual(worker.wait(5), 4, worker.text())
                self.assertRegex(worker.text(), "protocol version 3, this host speaks 2")
            finally:
                for peer in peers:
                    peer.close()

    def test_4_without_workers(self):
        port = support.free_ports(1)[0]
        result = self.expect(4, "manager", support.SCENE, "-o", self.folder / "a.exr", *TINY, "--listen",
                             f"127.0.0.1:{port}", "--wait", "2")
        self.assertGreater(result.wall, 1.5, "it did not wait")
        self.assertLess(result.wall, 20)


if __name__ == "__main__":
    support.main()
