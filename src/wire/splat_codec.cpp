// What paths from lights bring to pixels, behind the other columns of path ends and of renderer tasks' replies.
#include <algorithm>

#include "wire/columns.h"

namespace cloudrenderer::wire {
namespace {

constexpr std::uint32_t kMaxSplats = 1u << 26;  // of a reply: no task has more paths

bool has_splat(const PathEnd& e) { return e.target != PathEnd().target; }

}  // namespace

void set_control(std::span<const Splat> splats, ReplyControl& c) {
  if (splats.empty()) return;
  std::uint32_t width = 1;
  for (const Splat& s : splats)
    for (const auto& half : s.sum)
      for (const Int128& v : half) width = std::max(width, width_of(v));
  c.set_splats(static_cast<std::uint32_t>(splats.size()));
  c.set_splat_bytes(width);
}

void set_control(std::span<const PathEnd> ends, EndsControl& c) {
  std::uint32_t count = 0, width = 1;
  for (const PathEnd& e : ends) {
    if (!has_splat(e)) continue;
    ++count;
    for (const std::int64_t v : e.splat) width = std::max(width, width_of(v));
  }
  if (count == 0) return;
  c.set_splats(count);
  c.set_splat_bytes(width);
}

std::size_t splats_bytes(const ReplyControl& c) { return c.splats() * (4 + 6 * std::size_t{c.splat_bytes()}); }
std::size_t splats_bytes(const EndsControl& c) { return c.splats() * (8 + 3 * std::size_t{c.splat_bytes()}); }

void write_splats(std::span<const Splat> splats, const ReplyControl& c, ColumnWriter& w) {
  for (const Splat& s : splats) w.put(s.pixel);
  for (const Splat& s : splats)
    for (const auto& half : s.sum)
      for (const Int128& v : half) w.put_low(&v, c.splat_bytes());
}

void write_splats(std::span<const PathEnd> ends, const EndsControl& c, ColumnWriter& w) {
  if (c.splats() == 0) return;
  for (std::uint32_t i = 0; i < ends.size(); ++i)
    if (has_splat(ends[i])) w.put(i);
  for (const PathEnd& e : ends)
    if (has_splat(e)) w.put(e.target);
  for (const PathEnd& e : ends)
    if (has_splat(e))
      for (const std::int64_t& v : e.splat) w.put_low(&v, c.splat_bytes());
}

bool good_splats(const ReplyControl& c) {
  return c.splats() <= kMaxSplats && (c.splats() == 0 || (c.splat_bytes() >= 1 && c.splat_bytes() <= 16));
}

bool good_splats(const EndsControl& c) {
  return c.splats() <= c.count() && (c.splats() == 0 || (c.splat_bytes() >= 1 && c.splat_bytes() <= 8));
}

void read_splats(const ReplyControl& c, ColumnReader& in, std::vector<Splat>& splats) {
  splats.resize(c.splats());
  for (Splat& s : splats) in.get(s.pixel);
  for (Splat& s : splats)
    for (auto& half : s.sum)
      for (Int128& v : half) v = in.get_int128(c.splat_bytes());
}

// False: a splat names no end, or one out of turn.
bool read_splats(const EndsControl& c, ColumnReader& in, std::vector<PathEnd>& ends) {
  std::vector<std::uint32_t> of(c.splats());
  std::uint32_t least = 0;
  for (std::uint32_t& i : of) {
    in.get(i);
    if (i < least || i >= ends.size()) return false;
    least = i + 1;
  }
  for (const std::uint32_t i : of) in.get(ends[i].target);
  for (const std::uint32_t i : of)
    for (std::int64_t& v : ends[i].splat) v = in.get_int(c.splat_bytes());
  return true;
}

}  // namespace cloudrenderer::wire
