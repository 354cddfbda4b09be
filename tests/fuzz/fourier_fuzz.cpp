#include "fuzz/fuzz.h"
#include "shading/fourier.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  try {
    const auto table = FourierTable::read(file.path(), {});
    const Vec3 wo(0.48f, 0.64f, 0.6f);
    for (const Vec3& wi : {Vec3(0, 0, 1), Vec3(0.6f, 0, 0.8f), Vec3(0, -1, 0), Vec3(0, 0.6f, -0.8f)}) {
      const Rgb v = table->value(wo, wi);
      fuzz::require(v.x >= 0 && v.y >= 0 && v.z >= 0, "a reflectance");
      fuzz::require(table->pdf(wo, wi) >= 0, "a density");
    }
    for (const float u : {0.f, 0.01f, 0.3f, 0.99f}) {
      Vec3 wi;
      if (!table->sample(wo, u, {u, 1.f - u}, wi)) continue;
      fuzz::require(std::fabs(glm::dot(wi, wi) - 1.f) < 1e-4f, "a sample is a direction");
    }
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
  return 0;
}
