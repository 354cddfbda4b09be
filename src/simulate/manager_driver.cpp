#include "simulate/manager_driver.h"

#include <ctime>

#include <algorithm>

namespace cloudrenderer::sim {
namespace {

// What a socket takes for a frame, and for a byte of it: half of what both ends take over the loopback (facts of a
// measurement with frames of 4 KiB and 64 KiB: 5.3 and 28 us).
constexpr double kFrame = 1.9e-6, kByte = 0.19e-9;
constexpr int kReplyRuns = 9;

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

// Decoding it and adding it to a film.
double reply_seconds(const wire::Bytes& bytes, std::uint64_t pixels) {
  const auto width = static_cast<std::uint32_t>(pixels);
  Film film({width, 1, 0, 0, width, 1}, 30);
  std::vector<double> runs;
  for (int i = 0; i < kReplyRuns; ++i) {
    const double start = thread_cpu_seconds();
    const auto message = wire::decode(*bytes);
    const auto& sums = std::get<wire::RendererReply>(std::get<wire::Reply>(*message).payload).sums;
    for (std::uint32_t x = 0; x < width; ++x) film.at(x, 0).merge(sums[x]);
    runs.push_back(thread_cpu_seconds() - start);
  }
  std::ranges::nth_element(runs, runs.begin() + kReplyRuns / 2);
  return runs[kReplyRuns / 2];
}

}  // namespace

double thread_cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

ManagerDriver::ManagerDriver(const ManagerOptions& options, JobSpec job, std::uint64_t real_pixels, Transmit transmit)
    : core_(options, std::move(job)), transmit_(std::move(transmit)) {
  const wire::Bytes reply = wire::encode(real_reply(real_pixels));
  reply_bytes_ = reply->size();
  reply_s_ = reply_seconds(reply, real_pixels);
}

void ManagerDriver::measure(double now, double seconds) {
  const auto second = static_cast<std::size_t>(now);
  if (cpu_.size() <= second) cpu_.resize(second + 1);
  cpu_[second] += seconds;
}

std::uint64_t ManagerDriver::frame_bytes(const Link::Frame& frame, bool renderer_reply) const {
  if (renderer_reply) return wire::kFrameHeaderBytes + reply_bytes_;
  return wire::kFrameHeaderBytes + (frame.payload ? frame.payload->size() : 0);
}

Result<HostId> ManagerDriver::join(const wire::Hello& hello, double now) {
  const double start = thread_cpu_seconds();
  const auto id = core_.join(hello, now);
  if (id) links_.try_emplace(*id, low(1), low(hello.incarnation()));
  drain(now);
  measure(now, thread_cpu_seconds() - start);
  return id;
}

void ManagerDriver::receive(HostId from, const Link::Frame& frame, double now) {
  const auto link = links_.find(from);
  if (link == links_.end()) return;
  const double start = thread_cpu_seconds();
  double real = kFrame;
  std::vector<wire::Bytes> in_order;
  link->second.receive(frame.link, frame.payload, now, in_order);
  std::uint64_t bytes = frame_bytes(frame, false);
  for (const wire::Bytes& payload : in_order) {
    auto message = wire::decode(*payload);
    ++messages_;
    if (!message) continue;
    const auto* reply = std::get_if<wire::Reply>(&*message);
    if (reply && std::holds_alternative<wire::RendererReply>(reply->payload)) {
      real += reply_s_;
      bytes = frame_bytes(frame, true);
    }
    core_.receive(from, std::move(*message), now);
  }
  received_ += bytes;
  drain(now);
  measure(now, thread_cpu_seconds() - start + real + kByte * static_cast<double>(bytes));
}

void ManagerDriver::tick(double now) {
  const double start = thread_cpu_seconds();
  core_.tick(now);
  drain(now);
  measure(now, thread_cpu_seconds() - start);
}

void ManagerDriver::host_lost(HostId host, double now) {
  const double start = thread_cpu_seconds();
  core_.host_lost(host, now);
  drain(now);
  measure(now, thread_cpu_seconds() - start);
}

void ManagerDriver::acknowledge(HostId host, double now) {
  const auto link = links_.find(host);
  if (link == links_.end()) return;
  const double start = thread_cpu_seconds();
  send_all(host, link->second, now);
  measure(now, thread_cpu_seconds() - start);
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
    measure(now, kFrame + kByte * bytes);
    transmit_(to, *frame);
  }
}

ManagerLoad ManagerDriver::load(double began, double ended) const {
  ManagerLoad l;
  double while_rendering = 0;
  for (std::size_t second = 0; second < cpu_.size(); ++second) {
    l.cpu_s += cpu_[second];
    l.peak_share = std::max(l.peak_share, cpu_[second]);
    const auto at = static_cast<double>(second);
    while_rendering += cpu_[second] * std::clamp(std::min(ended, at + 1) - std::max(began, at), 0.0, 1.0);
  }
  for (const double bytes : sent_) l.sent += bytes;
  l.received = static_cast<double>(received_);
  l.messages = messages_;
  l.cpu_share = ended > began ? while_rendering / (ended - began) : 0;
  return l;
}

}  // namespace cloudrenderer::sim
