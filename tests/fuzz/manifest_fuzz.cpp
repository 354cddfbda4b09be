#include "fuzz/fuzz.h"
#include "parts/part.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Result<Manifest> manifest = decode_manifest(fuzz::input(data, size));
  if (!manifest) return 0;
  const std::string once = encode(*manifest);
  const Result<Manifest> again = decode_manifest(std::as_bytes(std::span(once)));
  fuzz::require(static_cast<bool>(again), "what was accepted can be sent on");
  fuzz::require(encode(*again) == once, "nothing is lost on the way");
  return 0;
}
