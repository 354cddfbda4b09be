"""The program starts with few libraries: what OpenImageIO brings along waits for the first picture (src/images/images.h)."""
import subprocess
import sys
import unittest

MOST = 60  # 25 with Debian 12; 268 with OpenImageIO


class LinkedLibraries(unittest.TestCase):
    def test_pictures_are_not_loaded_at_the_start(self):
        libraries = subprocess.run(["ldd", PROGRAM], capture_output=True, text=True, check=True).stdout.split("\n")
        self.assertLess(len(libraries), MOST, "\n".join(libraries))
        self.assertEqual([x for x in libraries if "OpenImageIO" in x or "opencv" in x], [])
        self.assertNotEqual([x for x in libraries if "embree" in x], [])


if __name__ == "__main__":
    PROGRAM = sys.argv.pop()
    unittest.main()
