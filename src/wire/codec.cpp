#include "wire/codec.h"

#include <xxhash.h>

#include <cstring>
#include <string>
#include <type_traits>
#include <utility>

#include "wire/bulk_codec.h"
#include "wire/checks.h"

namespace cloudrenderer::wire {
namespace {

constexpr std::size_t kCheckedBefore =
    8;  // type, version, control length: they are part of the checksum
constexpr std::size_t kHeaderChecked = 20;
constexpr std::uint32_t kAfterLength = kFrameHeaderBytes - 4;

template <class T>
inline constexpr bool kHasBulk =
    std::is_same_v<T, SubmitTask> || std::is_same_v<T, Reply> || std::is_same_v<T, PathEnds>;

std::uint64_t checksum(std::span<const std::byte> payload) {
  // The fields before the checksum seed the hash of what comes after it.
  std::uint64_t head;
  std::memcpy(&head, payload.data(), kCheckedBefore);
  return XXH3_64bits_withSeed(payload.data() + kPayloadHeaderBytes,
                              payload.size() - kPayloadHeaderBytes, head);
}

std::uint32_t header_check(const std::byte* header) {
  return static_cast<std::uint32_t>(XXH3_64bits(header, kHeaderChecked));
}

// Reserves a payload, writes header and control, and returns where the bulk begins.
template <class Control>
std::size_t write_control(std::vector<std::byte>& out, std::size_t type, const Control& control,
                          std::size_t bulk_bytes) {
  const std::size_t control_bytes = control.ByteSizeLong();
  out.resize(kPayloadHeaderBytes + control_bytes + bulk_bytes);
  const auto type16 = static_cast<std::uint16_t>(type),
             version = static_cast<std::uint16_t>(kProtocolVersion);
  const auto control32 = static_cast<std::uint32_t>(control_bytes);
  std::memcpy(out.data(), &type16, 2);
  std::memcpy(out.data() + 2, &version, 2);
  std::memcpy(out.data() + 4, &control32, 4);
  control.SerializeWithCachedSizesToArray(
      reinterpret_cast<std::uint8_t*>(out.data() + kPayloadHeaderBytes));
  return kPayloadHeaderBytes + control_bytes;
}

template <class Control>
bool parse(Control& control, std::span<const std::byte> bytes) {
  return control.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

Result<Message> failure(const std::string& why) { return Result<Message>::failure(why); }

template <class Control>
Result<Message> decode_bulk(Result<Message> (*read)(const Control&, std::span<const std::byte>),
                            std::span<const std::byte> control, std::span<const std::byte> bulk) {
  Control c;
  if (!parse(c, control)) return failure("the control part cannot be parsed");
  return read(c, bulk);
}

template <std::size_t I>
Result<Message> decode_as(std::span<const std::byte> control, std::span<const std::byte> bulk) {
  using T = std::variant_alternative_t<I, Message>;
  if constexpr (std::is_same_v<T, SubmitTask>) {
    return decode_bulk(read_submit, control, bulk);
  } else if constexpr (std::is_same_v<T, Reply>) {
    return decode_bulk(read_reply, control, bulk);
  } else if constexpr (std::is_same_v<T, PathEnds>) {
    return decode_bulk(read_ends, control, bulk);
  } else {
    T m;
    if (!bulk.empty()) return failure("this message has no bulk");
    if (!parse(m, control)) return failure("the message cannot be parsed");
    if (const char* why = check(m)) return failure(why);
    return Message(std::move(m));
  }
}

using Decoder = Result<Message> (*)(std::span<const std::byte>, std::span<const std::byte>);
template <std::size_t... I>
constexpr std::array<Decoder, sizeof...(I)> decoders(std::index_sequence<I...>) {
  return {&decode_as<I>...};
}
constexpr auto kDecoders = decoders(std::make_index_sequence<std::variant_size_v<Message>>());

constexpr std::array<const char*, std::variant_size_v<Message>> kNames = {
    "Challenge",   "Proof",        "Hello",       "Welcome",   "Refused",    "PeerHello",
    "HostList",    "SceneHostMap", "JobStart",    "JobEnd",    "CancelJob",  "LoadParts",
    "UnloadParts", "LoadReport",   "BlobRequest", "BlobChunk", "SubmitTask", "Reply",
    "PathEnds",    "Status",       "Leave",       "Error",     "CancelTask", "PoolWelcome",
    "PoolOrders",  "PoolStatus"};

}  // namespace

const char* message_name(const Message& m) { return kNames[m.index()]; }

std::array<std::byte, kFrameHeaderBytes> encode_frame_header(const LinkHeader& link,
                                                             std::size_t payload_bytes) {
  std::array<std::byte, kFrameHeaderBytes> out;
  const auto length = static_cast<std::uint32_t>(payload_bytes + kAfterLength);
  const std::array<std::uint32_t, 5> fields{length, link.incarnation, link.sequence, link.ack,
                                            link.window};
  std::memcpy(out.data(), fields.data(), sizeof fields);
  const std::uint32_t check = header_check(out.data());
  std::memcpy(out.data() + kHeaderChecked, &check, sizeof check);
  return out;
}

Result<FrameHeader> decode_frame_header(std::span<const std::byte, kFrameHeaderBytes> bytes) {
  std::array<std::uint32_t, 6> f;
  std::memcpy(f.data(), bytes.data(), sizeof f);
  if (f[0] < kAfterLength || f[0] > kMaxFrameBytes - 4)
    return Result<FrameHeader>::failure("the frame's length is out of range");
  if (f[5] != header_check(bytes.data()))
    return Result<FrameHeader>::failure("the check of the frame's header does not match");
  return FrameHeader{f[0] - kAfterLength, {f[1], f[2], f[3], f[4]}};
}

Bytes encode(const Message& m) {
  auto out = std::make_shared<std::vector<std::byte>>();
  std::visit(
      [&]<class T>(const T& message) {
        if constexpr (kHasBulk<T>) {
          const auto control = control_of(message);
          const std::size_t bulk =
              write_control(*out, m.index(), control, bulk_bytes(message, control));
          write_bulk(message, control, std::span(*out).subspan(bulk));
        } else {
          write_control(*out, m.index(), message, 0);
        }
      },
      m);
  const std::uint64_t sum = checksum(*out);
  std::memcpy(out->data() + kCheckedBefore, &sum, 8);
  return out;
}

bool is_intact(std::span<const std::byte> payload) {
  if (payload.size() < kPayloadHeaderBytes) return false;
  std::uint64_t sum;
  std::memcpy(&sum, payload.data() + kCheckedBefore, 8);
  return checksum(payload) == sum;
}

Result<Message> decode(std::span<const std::byte> payload) {
  if (payload.size() < kPayloadHeaderBytes) return failure("a payload is shorter than its header");
  if (payload.size() > kMaxFrameBytes) return failure("a payload is too long");
  std::uint16_t type, version;
  std::uint32_t control_bytes;
  std::memcpy(&type, payload.data(), 2);
  std::memcpy(&version, payload.data() + 2, 2);
  std::memcpy(&control_bytes, payload.data() + 4, 4);
  if (version != kProtocolVersion)
    return failure("protocol version " + std::to_string(version) + ", this host speaks " +
                   std::to_string(kProtocolVersion));
  if (type >= kDecoders.size()) return failure("unknown message type " + std::to_string(type));
  if (control_bytes > payload.size() - kPayloadHeaderBytes)
    return failure("the control part is longer than the payload");
  if (!is_intact(payload)) return failure("the checksum does not match");
  const auto rest = payload.subspan(kPayloadHeaderBytes);
  return kDecoders[type](rest.first(control_bytes), rest.subspan(control_bytes));
}

}  // namespace cloudrenderer::wire
