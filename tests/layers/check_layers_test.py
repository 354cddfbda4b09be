"""The layer check finds what it is for, and lets pass what is allowed."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "tools" / "check_layers.py"


def run(files):
    with tempfile.TemporaryDirectory() as root:
        for name, text in files.items():
            path = pathlib.Path(root, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return subprocess.run([sys.executable, SCRIPT, root], capture_output=True, text=True)


class CheckLayers(unittest.TestCase):
    def expect(self, files, code, words=""):
        result = run(files)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        self.assertIn(words, result.stdout)

    def test_lets_includes_point_down(self):
        self.expect({"src/cli/a.cpp": '#include "base/log.h"\n#include "cloudrenderer/math.h"\n#include <vector>\n'}, 0)

    def test_finds_an_include_that_points_up(self):
        self.expect({"src/base/a.h": '#include <vector>\n#include "parts/part.h"\n'}, 1, "src/base/a.h:2: error")

    def test_finds_embree_outside_trace(self):
        self.expect({"src/film/a.cpp": "#include <embree3/rtcore.h>\n"}, 1, "trace only")
        self.expect({"src/trace/a.cpp": "#include <embree3/rtcore.h>\n"}, 0)

    def test_finds_openimageio_outside_images(self):
        self.expect({"src/film/a.cpp": "#include <OpenImageIO/imageio.h>\n"}, 1, "images only")
        self.expect({"src/images/a.cpp": "#include <OpenImageIO/imageio.h>\n"}, 0)

    def test_finds_sockets_below_net(self):
        self.expect({"src/tasks/a.cpp": "#include <asio.hpp>\n"}, 1, "cluster, net, service, web only")
        self.expect({"src/net/a.cpp": "#include <asio/ssl.hpp>\n"}, 0)

    def test_keeps_public_headers_free_of_the_inside(self):
        self.expect({"include/cloudrenderer/a.h": '#include "trace/hit.h"\n'}, 1, "public header")
        self.expect({"include/cloudrenderer/a.h": '#include "cloudrenderer/math.h"\n'}, 0)

    def test_refuses_a_folder_that_is_no_layer(self):
        self.expect({"src/misc/a.cpp": ""}, 1, "not a layer")

    def test_warns_about_long_files_without_failing(self):
        self.expect({"src/base/a.cpp": "\n" * 501}, 0, "warning: 501 lines")

    def test_fails_when_there_is_nothing_to_check(self):
        self.expect({"README.md": ""}, 1)


if __name__ == "__main__":
    unittest.main()
