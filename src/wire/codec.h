#pragma once
// Bytes <-> messages. No sockets, no state; any thread. The format is described in README.md.
//
//   frame   = u32 length of all that follows | link header (16) | u32 xxh3 of these 20 bytes | payload
//   payload = u16 type | u16 version | u32 control bytes | u64 xxh3 of type..control length,
//   control and bulk
//             | control (protobuf) | bulk (columns)
// All numbers little-endian. A frame without payload (length 20) only acknowledges.
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "wire/messages.h"

namespace cloudrenderer::wire {

inline constexpr std::size_t kMaxFrameBytes = std::size_t{16} << 20;  // length prefix included
inline constexpr std::size_t kMaxBlobChunk = std::size_t{1} << 20;
inline constexpr std::size_t kFrameHeaderBytes = 24;  // length, link header and their check
inline constexpr std::size_t kPayloadHeaderBytes = 16;
// No coordinate of a ray that comes from outside is larger: Embree's own limit is a little above.
inline constexpr float kMaxCoordinate = 1e18f;

using Bytes = std::shared_ptr<const std::vector<std::byte>>;  // an encoded payload

// What makes delivery exactly-once and in order; see tasks/link.h.
struct LinkHeader {
  std::uint32_t incarnation = 0;  // low half of the sender's
  std::uint32_t sequence =
      0;                  // from 1; 0: not part of the sequence (handshake, plain acknowledgement)
  std::uint32_t ack = 0;  // every sequence up to this one has arrived
  std::uint32_t window = 0;  // bit i: ack + 2 + i has arrived too
};

struct FrameHeader {
  std::uint32_t payload_bytes = 0;
  LinkHeader link;
};

std::array<std::byte, kFrameHeaderBytes> encode_frame_header(const LinkHeader& link,
                                                             std::size_t payload_bytes);
// Fails for altered headers and for lengths that no frame has: nothing may be allocated then, the
// connection is to be closed.
Result<FrameHeader> decode_frame_header(std::span<const std::byte, kFrameHeaderBytes> bytes);

// The payload of a message. The caller keeps blocks below the cap (cores do).
Bytes encode(const Message& m);
// The payload is as its sender made it. Asked before a link takes a frame: what is acknowledged never
// comes again.
bool is_intact(std::span<const std::byte> payload);
// Checks the checksum, every length before anything is allocated, and every value that could do
// harm: rays must be finite, below kMaxCoordinate, with a direction near unit length.
Result<Message> decode(std::span<const std::byte> payload);

}  // namespace cloudrenderer::wire
