#include "fuzz/fuzz.h"
#include "shading/rgl_table.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  try {
    const auto table = RglTable::read(file.path(), {});
    for (const Vec3& wo : {Vec3(0.48f, 0.64f, 0.6f), Vec3(-0.6f, 0, -0.8f), Vec3(0, 0, 1)}) {
      for (const Vec3& wi : {Vec3(0, 0, 1), Vec3(0.6f, 0, 0.8f), Vec3(0, -1, 0), Vec3(0, 0.6f, -0.8f)}) {
        const Rgb v = table->value(wo, wi);
        fuzz::require(is_finite(v) && v.x >= 0 && v.y >= 0 && v.z >= 0, "a reflectance");
        const float density = table->pdf(wo, wi);
        fuzz::require(std::isfinite(density) && density >= 0, "a density");
      }
      for (const float u : {0.f, 0.01f, 0.3f, 0.99f}) {
        Vec3 wi;
        if (!table->sample(wo, u, {u, 1.f - u}, wi)) continue;
        fuzz::require(std::fabs(glm::dot(wi, wi) - 1.f) < 1e-4f, "a sample is a direction");
        fuzz::require(wi.z * wo.z > 0.f, "a sample is reflected");
      }
    }
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
  return 0;
}
