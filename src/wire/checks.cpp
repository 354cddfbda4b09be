#include "wire/checks.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "wire/codec.h"

namespace cloudrenderer::wire {
namespace {

constexpr std::uint32_t kMaxHosts = 0xffff;  // a segment's owner has 16 bits
constexpr std::uint32_t kMaxParts = 1u << 22;
constexpr std::uint32_t kMaxResolution = 1u << 16;
constexpr std::size_t kMaxText = 4096;
constexpr int kMaxPoolJobs = 1024;  // in one message
constexpr std::size_t kMaxJobName = 128;
// Nobody makes camera rays while a host says that it is busy for long: one that says for ever would
// stop them all.
constexpr double kMaxLoad = 1e6;

bool is_amount(double v) { return std::isfinite(v) && v >= 0; }

bool is_load(double v) { return is_amount(v) && v <= kMaxLoad; }

// What is written to logs: nothing that begins a line there.
bool is_text(const std::string& s) {
  return s.size() <= kMaxText && std::none_of(s.begin(), s.end(), [](char c) {
           return static_cast<unsigned char>(c) < ' ' || c == 0x7f;
         });
}

bool is_job_name(const std::string& s) {
  return !s.empty() && s.size() <= kMaxJobName && is_text(s);
}

template <class Numbers>
bool all_below(const Numbers& numbers, std::uint32_t limit) {
  for (const std::uint32_t n : numbers)
    if (n >= limit) return false;
  return true;
}

template <class Entries>
const char* check_entries(const Entries& entries) {
  for (const HostEntry& e : entries) {
    if (e.host() == 0 || e.host() >= kMaxHosts) return "a host number is out of range";
    if (!is_load(e.load_s()) || !is_amount(e.segments_per_s())) return "a host's load is no amount";
    if (!is_text(e.name()) || !is_text(e.address()))
      return "a host's name or address is too long, or no text";
  }
  return nullptr;
}

}  // namespace

const char* check(const Hello& m) {
  if (!is_text(m.name()) || !is_text(m.listen()) || !is_text(m.instruction_set()) ||
      !is_text(m.version()) || !is_text(m.kind()) || m.features_size() > 64)
    return "a name is too long, or no text";
  return nullptr;  // what the numbers may be the manager says, so that the host hears it
}

const char* check(const Welcome& m) {
  if (m.host() == 0 || m.host() >= kMaxHosts) return "the host number is out of range";
  return is_amount(m.heartbeat_s()) && is_amount(m.lost_after_s()) ? nullptr
                                                                   : "a time is out of range";
}

const char* check(const PeerHello& m) {
  return m.host() >= kMaxHosts ? "the host number is out of range" : nullptr;
}

const char* check(const HostList& m) {
  if (m.changed_size() != m.load_s_size()) return "as many loads as hosts are expected";
  if (!all_below(m.changed(), kMaxHosts)) return "a host number is out of range";
  for (const float load : m.load_s())
    if (!is_load(load)) return "a host's load is no amount";
  if (!is_amount(m.heartbeat_s())) return "a time is out of range";
  return check_entries(m.hosts());
}

const char* check(const SceneHostMap& m) {
  if (m.part_count() > kMaxParts) return "too many parts";
  if (m.since() > m.epoch()) return "a change of a later map";
  if (!all_below(m.gone(), kMaxHosts)) return "a host number is out of range";
  for (const auto* list : {&m.holdings(), &m.drops()}) {
    for (const Holding& h : *list) {
      if (h.host() >= kMaxHosts) return "a host number is out of range";
      if (!all_below(h.parts(), m.part_count())) return "a part number is out of range";
    }
  }
  return check_entries(m.hosts());
}

const char* check(const JobStart& m) {
  if (m.width() == 0 || m.height() == 0 || m.width() > kMaxResolution ||
      m.height() > kMaxResolution || m.x0() >= m.x1() || m.y0() >= m.y1() || m.x1() > m.width() ||
      m.y1() > m.height())
    return "the frame is empty or out of range";
  if (m.part_count() == 0 || m.part_count() > kMaxParts)
    return "the number of parts is out of range";
  if (m.spp() == 0) return "no samples";
  if (m.light_paths() > 2) return "paths from lights of no kind";
  if (m.k() < -1000 || m.k() > 1000) return "the fixed point is out of range";
  return m.columns() & ~kAllColumns ? "unknown segment columns" : nullptr;
}

const char* check(const LoadParts& m) {
  return all_below(m.parts(), kMaxParts) ? nullptr : "no such part";
}
const char* check(const UnloadParts& m) {
  return all_below(m.parts(), kMaxParts) ? nullptr : "no such part";
}
const char* check(const LoadReport& m) {
  return all_below(m.loaded(), kMaxParts) && all_below(m.unloaded(), kMaxParts) &&
                 all_below(m.declined(), kMaxParts)
             ? nullptr
             : "no such part";
}

const char* check(const BlobRequest& m) {
  if (m.bytes() == 0 || m.bytes() > kMaxBlobChunk) return "a chunk has 1 byte to 1 MiB";
  return m.name().size() > kMaxText ? "the name is too long" : nullptr;
}

const char* check(const BlobChunk& m) {
  if (m.data().size() > kMaxBlobChunk) return "a chunk has at most 1 MiB";
  return m.error().empty() && (m.offset() > m.total() || m.data().size() > m.total() - m.offset())
             ? "a chunk lies outside of its blob"
             : nullptr;
}

const char* check(const Status& m) {
  if (m.visited_size() != m.rays_size()) return "as many counts of rays as parts are expected";
  if (static_cast<std::uint32_t>(m.visited_size()) > kMaxParts || !all_below(m.visited(), kMaxParts)) return "no such part";
  return is_load(m.load_s()) && is_amount(m.segments_per_s()) ? nullptr : "the load is no amount";
}

const char* check(const PoolWelcome& m) {
  return is_amount(m.heartbeat_s()) && is_amount(m.lost_after_s()) ? nullptr
                                                                   : "a time is out of range";
}

const char* check(const PoolOrders& m) {
  if (m.jobs_size() > kMaxPoolJobs) return "too many jobs";
  for (const PoolJob& j : m.jobs()) {
    if (!is_job_name(j.job())) return "a job's name is empty, too long, or no text";
    if (!is_text(j.manager())) return "a manager's address is too long, or no text";
    if (!is_amount(j.weight()) || j.weight() == 0) return "a weight is no amount";
  }
  return nullptr;
}

const char* check(const PoolStatus& m) {
  if (m.jobs_size() > kMaxPoolJobs) return "too many jobs";
  for (const PoolUse& u : m.jobs()) {
    if (!is_job_name(u.job())) return "a job's name is empty, too long, or no text";
    if (!is_amount(u.cpu_s()) || !is_amount(u.memory_byte_s()) || !is_amount(u.host_s()))
      return "what a job used is no amount";
  }
  return is_amount(m.cpu_s()) ? nullptr : "what a job used is no amount";
}

}  // namespace cloudrenderer::wire
