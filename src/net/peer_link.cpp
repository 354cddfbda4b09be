#include "net/peer_link.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace cloudrenderer {

PeerLink::PeerLink(asio::io_context& io, std::uint64_t own_incarnation,
                   std::uint64_t peer_incarnation, Now now)
    : now_(std::move(now)),
      link_(static_cast<std::uint32_t>(own_incarnation),
            static_cast<std::uint32_t>(peer_incarnation)),
      timer_(io) {}

void PeerLink::send(wire::Bytes payload) {
  const std::lock_guard lock(mutex_);
  link_.send(std::move(payload));
  pump();
}

void PeerLink::attach(std::shared_ptr<Session> session) {
  const std::lock_guard lock(mutex_);
  if (session_) session_->close("it has connected again");
  session_ = std::move(session);
  link_.reconnected();
  pump();
}

void PeerLink::detach(const Session* session) {
  const std::lock_guard lock(mutex_);
  if (session_.get() == session) session_.reset();
}

void PeerLink::close_if_silent(double seconds) {
  const std::lock_guard lock(mutex_);
  const double now = now_();
  // Who was away itself (stopped, starved) has not listened: what came meanwhile is yet to be read.
  const bool away = now - looked_ > 0.5 * seconds;
  looked_ = now;
  const std::uint64_t bytes = session_ ? session_->bytes_received() : 0;
  if (away || !session_ || bytes != heard_bytes_ || link_.drained()) {
    heard_bytes_ = bytes;
    heard_ = now;
  } else if (now - heard_ > seconds) {
    session_->close("it has been silent for too long");
  }
}

std::vector<wire::Bytes> PeerLink::receive(WireFrame frame) {
  std::vector<wire::Bytes> delivered;
  const std::lock_guard lock(mutex_);
  link_.receive(frame.link, std::move(frame.payload), now_(), delivered);
  pump();
  arm();
  return delivered;
}

void PeerLink::pump() {
  if (!session_) return;
  const double now = now_();
  while (auto frame = link_.next(now)) session_->send({frame->link, std::move(frame->payload)});
}

void PeerLink::arm() {
  const double deadline = link_.deadline();
  if (armed_ || !std::isfinite(deadline) || !session_) return;
  armed_ = true;
  timer_.expires_after(std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(std::max(deadline - now_(), 0.0005))));
  timer_.async_wait([weak = weak_from_this()](const std::error_code& cancelled) {
    const auto self = weak.lock();
    if (cancelled || !self) return;
    const std::lock_guard lock(self->mutex_);
    self->armed_ = false;
    self->pump();
    self->arm();
  });
}

void PeerLink::close_when_sent() {
  const std::lock_guard lock(mutex_);
  timer_.cancel();
  if (session_) session_->close_when_sent();
  session_.reset();
}

bool PeerLink::connected() const {
  const std::lock_guard lock(mutex_);
  return session_ != nullptr;
}

std::size_t PeerLink::queued() const {
  const std::lock_guard lock(mutex_);
  return link_.queued();
}

std::shared_ptr<Session> PeerLink::session() const {
  const std::lock_guard lock(mutex_);
  return session_;
}

}  // namespace cloudrenderer
