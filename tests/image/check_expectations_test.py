"""The checks that judge pictures, judged themselves: what they read, what they let pass, what they find."""
import pathlib
import sys
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
import check_expectations  # noqa: E402
import measure  # noqa: E402


def only(line):
    expectations, _, _ = check_expectations.parse(line)
    return expectations[0]


class Expectations(unittest.TestCase):
    def test_relative_mean(self):
        expect = only("# expect mean 1.0 within 1%")
        self.assertIsNone(expect.check(np.full((4, 4, 3), 1.009)))
        self.assertIn("expected R = 1", expect.check(np.full((4, 4, 3), 1.011)))

    def test_channels_one_by_one(self):
        expect = only("# expect mean 1 2 3 within 1%")
        image = np.broadcast_to(np.array([1.0, 2.0, 3.1]), (2, 2, 3))
        self.assertIn("expected B = 3", expect.check(image))

    def test_absolute_tolerance_of_a_pixel(self):
        image = np.zeros((4, 4, 3))
        image[1, 3] = 0.2
        self.assertIsNone(only("# expect pixel 3 1 0.2 within 0.01").check(image))
        self.assertIsNotNone(only("# expect pixel 1 3 0.2 within 0.01").check(image))

    def test_region_is_columns_then_rows(self):
        image = np.zeros((4, 8, 3))
        image[:2, 4:] = 1
        self.assertIsNone(only("# expect region 4 8 0 2 1 within 0.1%").check(image))

    def test_nan_never_passes(self):
        self.assertIsNotNone(only("# expect mean 1 within 1%").check(np.full((2, 2, 3), np.nan)))

    def test_options_and_errors(self):
        _, options, error = check_expectations.parse("# render --spp 4 --hosts 2\n# expect error 3:7 radius\n")
        self.assertEqual(options, ["--spp", "4", "--hosts", "2"])
        self.assertEqual(error, ("3:7", "radius"))

    def test_a_scene_without_expectation_is_refused(self):
        for text in ("WorldBegin\n", "# expect means 1 within 1%\n", "# expect mean 1 2 within 1%\n"):
            with self.assertRaises(ValueError):
                check_expectations.parse(text)


class Comparison(unittest.TestCase):
    def test_a_picture_is_identical_to_itself(self):
        image = np.random.default_rng(1).random((20, 20, 3))
        found = measure.compare(image, image)
        self.assertTrue(found.identical)
        self.assertEqual(found.relmse, 0)

    def test_one_firefly_is_trimmed_and_a_bias_is_not(self):
        reference = np.ones((40, 50, 3))
        image = reference.copy()
        image[3, 3] = 100
        self.assertEqual(measure.compare(image, reference).trimmed, 0)
        found = measure.compare(reference * 1.1, reference)
        self.assertAlmostEqual(found.trimmed, 0.01 / 1.01, places=9)
        self.assertAlmostEqual(found.mean_ratio[0], 1.1, places=9)

    def test_nan_is_an_error(self):
        image = np.ones((4, 4, 3))
        image[0, 0, 0] = np.nan
        with self.assertRaises(ValueError):
            measure.compare(image, np.ones((4, 4, 3)))


if __name__ == "__main__":
    unittest.main()
