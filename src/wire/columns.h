#pragma once
// What writes and reads columns, and the checks that they share. Private to the codec.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "base/error.h"
#include "wire/messages.h"

namespace cloudrenderer::wire {

// Bytes that hold v in two's complement.
inline std::uint32_t width_of(std::int64_t v) {
  const auto magnitude = static_cast<std::uint64_t>(v < 0 ? ~v : v);
  return static_cast<std::uint32_t>((64 - std::countl_zero(magnitude)) / 8 + 1);
}
inline std::uint32_t width_of(const Int128& v) {
  const auto high = static_cast<std::int64_t>(v >> 64);
  const auto low = static_cast<std::int64_t>(static_cast<std::uint64_t>(v));
  if (high == (low < 0 ? -1 : 0)) return width_of(low);
  return 8 + width_of(high);
}

class ColumnWriter {
 public:
  explicit ColumnWriter(std::span<std::byte> out) : at_(out.data()) {}
  template <class T>
  void put(const T& v) {
    std::memcpy(at_, &v, sizeof v);
    at_ += sizeof v;
  }
  void put_low(const void* v, std::size_t bytes) {
    if (bytes == 0) return;  // v may be null
    std::memcpy(at_, v, bytes);
    at_ += bytes;
  }

 private:
  std::byte* at_;
};

class ColumnReader {
 public:
  explicit ColumnReader(std::span<const std::byte> in) : at_(in.data()), end_(in.data() + in.size()) {}
  template <class T>
  void get(T& v) {
    std::memcpy(&v, at_, sizeof v);
    at_ += sizeof v;
  }
  // Sign-extends.
  std::int64_t get_int(std::size_t bytes) {
    std::uint64_t v = 0;
    if (end_ - at_ >= 8)
      std::memcpy(&v, at_, 8);  // one instruction, where any other number is a call; what is not wanted is shifted out
    else
      std::memcpy(&v, at_, bytes);
    at_ += bytes;
    const auto shift = static_cast<int>(64 - 8 * bytes);
    return static_cast<std::int64_t>(v << shift) >> shift;
  }
  Int128 get_int128(std::size_t bytes) {
    if (bytes <= 8) return get_int(bytes);
    std::uint64_t low;
    get(low);
    const std::int64_t high = get_int(bytes - 8);
    return static_cast<Int128>(high) * (static_cast<Int128>(1) << 64) + low;
  }

 private:
  const std::byte* at_;
  const std::byte* end_;
};

inline std::size_t words(std::size_t bits) { return (bits + 63) / 64; }

// NaN fails every comparison.
inline bool within(float v, float limit) { return v >= -limit && v <= limit; }
inline bool within(const Vec3& v, float limit) {
  return within(v.x, limit) && within(v.y, limit) && within(v.z, limit);
}
inline bool at_least_zero(float v) { return v >= 0.f; }

template <class T>
Result<Message> failure(const T& why) {
  return Result<Message>::failure(why);
}

inline bool trailing_bits(std::span<const std::uint64_t> bits, std::size_t count) {
  return count % 64 != 0 && (bits.back() >> (count % 64)) != 0;
}

// splat_codec.cpp: what paths from lights bring to pixels.
void set_control(std::span<const Splat> splats, ReplyControl& c);
void set_control(std::span<const PathEnd> ends, EndsControl& c);
std::size_t splats_bytes(const ReplyControl& c);
std::size_t splats_bytes(const EndsControl& c);
void write_splats(std::span<const Splat> splats, const ReplyControl& c, ColumnWriter& w);
void write_splats(std::span<const PathEnd> ends, const EndsControl& c, ColumnWriter& w);
bool good_splats(const ReplyControl& c);  // in number and width
bool good_splats(const EndsControl& c);
void read_splats(const ReplyControl& c, ColumnReader& in, std::vector<Splat>& splats);
bool read_splats(const EndsControl& c, ColumnReader& in, std::vector<PathEnd>& ends);

// nearest_codec.cpp: the answers of hosts that only intersect.
void set_control(const NearestReply& r, ReplyControl& c);
std::size_t hit_bytes(const ReplyControl& c);
void write_nearest(const NearestReply& r, const ReplyControl& c, ColumnWriter& w);
Result<Message> read_nearest(Reply m, const ReplyControl& c, std::span<const std::byte> bulk);

}  // namespace cloudrenderer::wire
