#include "fuzz/fuzz.h"
#include "shading/measured.h"

using namespace cloudrenderer;

namespace {

template <class Read>
void try_reading(Read read) {
  try {
    const auto table = read();
    for (const Vec3& wi : {Vec3(0, 0, 1), Vec3(0.6f, 0, 0.8f), Vec3(0, -1, 0), Vec3(0, 0, -1)}) {
      const Rgb v = table->value(Vec3(0.48f, 0.64f, 0.6f), wi);
      fuzz::require(is_finite(v) && v.x >= 0 && v.y >= 0 && v.z >= 0, "a reflectance");
    }
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  try_reading([&] { return read_irregular_brdf(file.path(), Dialect::v2, {}); });
  try_reading([&] { return read_merl(file.path(), {}); });
  return 0;
}
