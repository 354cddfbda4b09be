#pragma once
// Checksums made right: random bytes would never reach what is behind them.
#include <xxhash.h>

#include <cstring>
#include <vector>

#include "fuzz/fuzz.h"
#include "wire/codec.h"

namespace cloudrenderer::fuzz {

// The payload of a wire message with the version and checksum that belong to it.
inline std::vector<std::byte> sealed_payload(Input bytes) {
  std::vector<std::byte> payload(bytes.begin(), bytes.end());
  if (payload.size() < wire::kPayloadHeaderBytes) payload.resize(wire::kPayloadHeaderBytes);
  const auto version = static_cast<std::uint16_t>(wire::kProtocolVersion);
  std::memcpy(payload.data() + 2, &version, 2);
  std::uint64_t head;
  std::memcpy(&head, payload.data(), 8);
  const std::uint64_t sum = XXH3_64bits_withSeed(payload.data() + wire::kPayloadHeaderBytes,
                                                 payload.size() - wire::kPayloadHeaderBytes, head);
  std::memcpy(payload.data() + 8, &sum, 8);
  return payload;
}

}  // namespace cloudrenderer::fuzz
