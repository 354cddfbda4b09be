#include "simulate/manager_driver.h"

#include <ctime>

#include <algorithm>
#include <tuple>

namespace cloudrenderer::sim {
namespace {

// What a socket takes for a frame, and for a byte of it: half of what both ends take over the loopback (facts of a
// measurement with frames of 4 KiB and 64 KiB: 5.3 and 28 us).
constexpr double kFrame = 1.9e-6, kByte = 0.19e-9;
constexpr int kReplyRuns = 9, kClockRuns = 99;

std::uint32_t low(std::uint64_t v) { return static_cast<std::uint32_t>(v); }

// A reply as it is after some thousand samples.
wire::Message real_reply(std::uint64_t pixels) {
  wire::RendererReply r;
  r.sums.resize(pixels);
  for (PixelSums& p : r.sums) {
    p.count = {8, 8};
    for (auto& half : p.sum)
      for (Int128& sum : half) sum = Int128{1} << 36;
  }
  return wire::Reply{{1, 1}, 1, std::move(r)};
}

double median(std::vector<double> runs) {
  std::ranges::nth_element(runs, runs.begin() + static_cast<std::ptrdiff_t>(runs.size() / 2));
  return runs[runs.size() / 2];
}

// Decoding it, and adding it to a film.
std::pair<double, double> reply_seconds(const wire::Bytes& bytes, std::uint64_t pixels) {
  const auto width = static_cast<std::uint32_t>(pixels);
  Film film({width, 1, 0, 0, width, 1}, 30);
  std::vector<double> decoding, merging;
  for (int i = 0; i < kReplyRuns; ++i) {
    const double start = thread_cpu_seconds();
    const auto message = wire::decode(*bytes);
    const double decoded = thread_cpu_seconds();
    const auto& sums = std::get<wire::RendererReply>(std::get<wire::Reply>(*message).payload).sums;
    for (std::uint32_t x = 0; x < width; ++x) film.at(x, 0).merge(sums[x]);
    decoding.push_back(decoded - start);
    merging.push_back(thread_cpu_seconds() - decoded);
  }
  return {median(decoding), median(merging)};
}

double clock_seconds() {
  std::vector<double> runs;
  double before = thread_cpu_seconds();
  for (int i = 0; i < kClockRuns; ++i) {
    const double now = thread_cpu_seconds();
    runs.push_back(now - std::exchange(before, now));
  }
  return median(runs);
}

}  // namespace

double thread_cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

ManagerDriver::ManagerDriver(const ManagerOptions& options, JobSpec job, std::uint64_t real_pixels, std::uint64_t pixels_of_one,
                             Transmit transmit)
    : core_(options, std::move(job)), transmit_(std::move(transmit)), real_pixels_(real_pixels), pixels_of_one_(pixels_of_one) {
  const wire::Bytes reply = wire::encode(real_reply(real_pixels));
  reply_bytes_ = reply->size();
  std::tie(decode_s_, merge_s_) = reply_seconds(reply, real_pixels);
  decode_s_ /= static_cast<double>(real_pixels);
  merge_s_ /= static_cast<double>(real_pixels);
  clock_s_ = clock_seconds();
}

ManagerDriver::Work ManagerDriver::work_of(const wire::Message& message) {
  if (std::holds_alternative<wire::Reply>(message)) return Work::tasks;
  if (std::holds_alternative<wire::Status>(message)) return Work::heartbeats;
  if (std::holds_alternative<wire::LoadReport>(message)) return Work::loading;
  return Work::maps;
}

void ManagerDriver::measure(double now, Work work, double seconds) {
  const auto second = static_cast<std::size_t>(now);
  std::vector<double>& cpu = cpu_[static_cast<std::size_t>(work)];
  if (cpu.size() <= second) cpu.resize(second + 1);
  cpu[second] += seconds;
}

void ManagerDriver::finish(double now, Work work, double start) {
  measure(now, work, std::max(0.0, thread_cpu_seconds() - start - clock_s_) + std::exchange(unmeasured_, 0));
  for (const auto& [to, frame] : outgoing_) transmit_(to, frame);
  outgoing_.clear();
}

std::uint64_t ManagerDriver::real_pixels(std::uint64_t reply_sums) const {
  return std::min(real_pixels_, reply_sums * pixels_of_one_);
}

std::uint64_t ManagerDriver::frame_bytes(const Link::Frame& frame, std::uint64_t reply_sums) const {
  if (reply_sums != 0) return wire::kFrameHeaderBytes + reply_bytes_ * real_pixels(reply_sums) / real_pixels_;
  return wire::kFrameHeaderBytes + (frame.payload ? frame.payload->size() : 0);
}

Result<HostId> ManagerDriver::join(const wire::Hello& hello, double now) {
  const double start = thread_cpu_seconds();
  const auto id = core_.join(hello, now);
  if (id) links_.try_emplace(*id, low(1), low(hello.incarnation()));
  drain(now);
  finish(now, Work::loading, start);
  return id;
}

void ManagerDriver::receive(HostId from, const Link::Frame& frame, double now) {
  const auto link = links_.find(from);
  if (link == links_.end()) return;
  double start = thread_cpu_seconds();
  std::vector<wire::Bytes> in_order;
  link->second.receive(frame.link, frame.payload, now, in_order);
  std::uint64_t bytes = frame_bytes(frame, 0);
  double from_socket = kByte * static_cast<double>(bytes);
  Work work = Work::acknowledgements;
  for (const wire::Bytes& payload : in_order) {
    const double before = thread_cpu_seconds();
    auto message = wire::decode(*payload);
    ++messages_;
    if (!message) continue;
    work = work_of(*message);
    const auto* reply = std::get_if<wire::Reply>(&*message);
    if (const auto* r = reply ? std::get_if<wire::RendererReply>(&reply->payload) : nullptr) {
      // What the simulated one takes to decode does not count; what it takes to merge does, where it is.
      start += thread_cpu_seconds() - before;
      bytes = frame_bytes(frame, r->sums.size());
      from_socket = 0;  // it is the film's, below
      const std::uint64_t pixels = real_pixels(r->sums.size()), missing = pixels - std::min<std::uint64_t>(pixels, r->sums.size());
      measure(now, Work::film,
              decode_s_ * static_cast<double>(pixels) + merge_s_ * static_cast<double>(missing) + kByte * static_cast<double>(bytes));
    }
    core_.receive(from, std::move(*message), now);
  }
  received_ += bytes;
  unmeasured_ += kFrame + from_socket;
  drain(now);
  finish(now, work, start);
}

void ManagerDriver::tick(double now) {
  const double start = thread_cpu_seconds();
  core_.tick(now);
  drain(now);
  finish(now, Work::maps, start);
}

void ManagerDriver::host_lost(HostId host, double now) {
  const double start = thread_cpu_seconds();
  core_.host_lost(host, now);
  drain(now);
  finish(now, Work::maps, start);
}

void ManagerDriver::acknowledge(HostId host, double now) {
  const auto link = links_.find(host);
  if (link == links_.end()) return;
  const double start = thread_cpu_seconds();
  send_all(host, link->second, now);
  finish(now, Work::acknowledgements, start);
}

double ManagerDriver::link_deadline(HostId host) const {
  const auto link = links_.find(host);
  return link == links_.end() ? std::numeric_limits<double>::infinity() : link->second.deadline();
}

void ManagerDriver::drain(double now) {
  for (auto sendings = core_.take_sendings(); !sendings.empty(); sendings = core_.take_sendings()) {
    for (const ManagerCore::Sending& s : sendings) {
      if (std::holds_alternative<wire::Welcome>(s.message)) continue;
      const wire::Bytes encoded = wire::encode(s.message);  // once for all, as the real driver does
      for (const HostId to : s.to) {
        const auto link = links_.find(to);
        if (link == links_.end()) continue;
        link->second.send(encoded);
        send_all(to, link->second, now);
      }
    }
  }
  for (const HostId h : core_.take_gone()) {
    links_.erase(h);
    gone_.push_back(h);
  }
}

void ManagerDriver::send_all(HostId to, Link& link, double now) {
  while (const auto frame = link.next(now)) {
    const auto header = wire::encode_frame_header(frame->link, frame->payload ? frame->payload->size() : 0);
    const auto bytes = static_cast<double>(header.size() + (frame->payload ? frame->payload->size() : 0));
    const auto second = static_cast<std::size_t>(now);
    if (sent_.size() <= second) sent_.resize(second + 1);
    sent_[second] += bytes;
    unmeasured_ += kFrame + kByte * bytes;
    outgoing_.emplace_back(to, *frame);
  }
}

ManagerLoad ManagerDriver::load(double began, double ended) const {
  ManagerLoad l;
  std::vector<double> in_second;
  for (std::size_t work = 0; work < cpu_.size(); ++work) {
    double while_rendering = 0;
    in_second.resize(std::max(in_second.size(), cpu_[work].size()));
    for (std::size_t second = 0; second < cpu_[work].size(); ++second) {
      const double cpu = cpu_[work][second], at = static_cast<double>(second);
      l.cpu_s += cpu;
      l.peak_share = std::max(l.peak_share, in_second[second] += cpu);
      while_rendering += cpu * std::clamp(std::min(ended, at + 1) - std::max(began, at), 0.0, 1.0);
    }
    const double share = ended > began ? while_rendering / (ended - began) : 0;
    l.share_of[kWork[work]] = share;
    l.cpu_share += share;
  }
  for (const double bytes : sent_) l.sent += bytes;
  l.received = static_cast<double>(received_);
  l.messages = messages_;
  return l;
}

}  // namespace cloudrenderer::sim
