#include "fuzz/fuzz.h"
#include "scene/spectrum.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::MemoryFile file(fuzz::input(data, size));
  try {
    const SampledSpectrum spectrum = read_spd(file.path(), {});
    fuzz::require(spectrum.wavelengths.size() == spectrum.values.size(), "a value a wavelength");
    (void)spectrum_to_rgb(spectrum, Dialect::v2);
  } catch (const SceneError& e) {
    fuzz::require(std::string(e.what()).find("error: ") != std::string::npos, "an error says so");
  }
  return 0;
}
