#include <spdlog/fmt/fmt.h>

#include "cli/commands.h"

namespace cloudrenderer {
namespace {

Image read(const std::string& path) {
  try {
    return read_image(path);
  } catch (const std::exception& e) {
    throw UsageError(e.what());
  }
}

}  // namespace

int run_compare(const CompareOptions& options) {
  const Image a = read(options.a), b = read(options.b);
  ImageDifference d;
  try {
    d = compare_images(a, b);
  } catch (const std::exception& e) {
    throw UsageError(e.what());
  }
  fmt::print(
      "mse {:.6g}\nrelmse {:.6g}\nrelmse_trimmed {:.6g}\npsnr {:.4g}\nlargest_difference {:.6g}\n",
      d.mse, d.relmse, d.relmse_trimmed, d.psnr, d.largest);
  fmt::print("mean_ratio {:.5f} {:.5f} {:.5f}\nidentical {}\n", d.mean_ratio[0], d.mean_ratio[1],
             d.mean_ratio[2], d.identical ? "yes" : "no");
  if (!options.max_relmse || d.relmse <= *options.max_relmse) return kDone;
  fmt::print(stderr, "relmse {:.6g} is above {:.6g}\n", d.relmse, *options.max_relmse);
  return kBoundNotMet;
}

}  // namespace cloudrenderer
