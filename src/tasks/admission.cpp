#include "tasks/admission.h"

#include <cstdint>

namespace cloudrenderer {
namespace {

// What no host has: such numbers are an error, or meant to do harm.
constexpr std::uint32_t kAbsurdThreads = 1u << 16;
constexpr std::uint64_t kAbsurdMemory = std::uint64_t{1} << 50;

}  // namespace

std::optional<std::string> unbelievable(const wire::Hello& hello) {
  if (hello.protocol() != wire::kProtocolVersion)
    return "this cluster speaks protocol version " + std::to_string(wire::kProtocolVersion) + ", the host speaks " +
           std::to_string(hello.protocol());
  if (hello.threads() == 0 || hello.threads() > kAbsurdThreads)
    return "the host says that it has " + std::to_string(hello.threads()) + " threads; 1 to " + std::to_string(kAbsurdThreads) +
           " are believed";
  if (hello.memory() > kAbsurdMemory)
    return "the host says that it may use " + std::to_string(hello.memory() >> 40) + " TiB of memory; up to " +
           std::to_string(kAbsurdMemory >> 40) + " TiB are believed";
  return std::nullopt;
}

}  // namespace cloudrenderer
