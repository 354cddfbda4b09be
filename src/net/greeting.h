#pragma once
#include <functional>
#include <memory>
#include <string>

#include "net/handshake.h"
#include "net/session.h"

namespace cloudrenderer {

// What happens on a connection, in this order: proved (both ends know the secret), introduction
// (the first message that follows; true: the peer is trusted from here on), frames, closed. All on
// the I/O thread.
struct GreetingHandlers {
  std::function<void(const std::shared_ptr<Session>&)> proved;
  std::function<bool(const std::shared_ptr<Session>&, wire::Message&&)> introduced;
  std::function<void(const std::shared_ptr<Session>&, WireFrame)> frame;
  std::function<void(const std::shared_ptr<Session>&, const std::string& reason)> closed;
};

// Starts a session on the stream and runs the handshake. Whatever breaks the format closes the
// session with a reason.
std::shared_ptr<Session> greet(std::unique_ptr<Stream> stream, Handshake::Role role,
                               const std::string& secret, GreetingHandlers handlers,
                               const SessionLimits& limits = {});

// Sends a message of the handshake: outside the link's sequence.
void send_unsequenced(Session& session, const wire::Message& message);

}  // namespace cloudrenderer
