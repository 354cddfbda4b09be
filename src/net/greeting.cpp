#include "net/greeting.h"

#include <optional>

namespace cloudrenderer {
namespace {

struct Greeting {
  const Handshake::Role role;
  const std::string secret;
  GreetingHandlers handlers;
  std::optional<Handshake> handshake{};  // from open() on
  enum class Stage { proving, proved, known, refused } stage = Stage::proving;

  void open(Session& session) {
    handshake.emplace(role, secret, session.channel_binding());
    for (const wire::Message& m : handshake->begin()) send_unsequenced(session, m);
  }

  void receive(const std::shared_ptr<Session>& session, WireFrame frame) {
    if (stage == Stage::known) {
      // Closed before the link has taken it, it comes again over the next connection.
      if (frame.payload && !wire::is_intact(*frame.payload))
        return session->close("a message was altered on the way");
      return handlers.frame(session, std::move(frame));
    }
    if (stage == Stage::refused) return;  // it may have sent more before it has read why
    if (!frame.payload)
      return session->close("it acknowledges messages before it has introduced itself");
    Result<wire::Message> message = wire::decode(*frame.payload);
    if (!message) return session->close(message.error());
    if (!handshake->done()) {
      Result<std::vector<wire::Message>> answer = handshake->receive(*message);
      if (!answer) return session->close(answer.error());
      for (const wire::Message& m : *answer) send_unsequenced(*session, m);
      if (handshake->done()) {
        stage = Stage::proved;
        handlers.proved(session);
      }
      return;
    }
    // A challenge may come behind the proof.
    if (std::holds_alternative<wire::Challenge>(*message)) {
      Result<std::vector<wire::Message>> answer = handshake->receive(*message);
      if (!answer) return session->close(answer.error());
      for (const wire::Message& m : *answer) send_unsequenced(*session, m);
      return;
    }
    stage = Stage::refused;
    if (!handlers.introduced(session, std::move(*message))) return;
    stage = Stage::known;
    session->trust();
  }
};

}  // namespace

std::shared_ptr<Session> greet(std::unique_ptr<Stream> stream, Handshake::Role role,
                               const std::string& secret, GreetingHandlers handlers,
                               const SessionLimits& limits) {
  auto session = std::make_shared<Session>(std::move(stream), limits);
  auto greeting = std::make_shared<Greeting>(Greeting{role, secret, std::move(handlers)});
  // The session owns its handlers until it ends; they must not own the session.
  const std::weak_ptr<Session> weak = session;
  session->start({[weak, greeting](WireFrame frame) {
                    if (const auto s = weak.lock()) greeting->receive(s, std::move(frame));
                  },
                  [weak, greeting](const std::string& reason) {
                    if (const auto s = weak.lock()) greeting->handlers.closed(s, reason);
                  },
                  [weak, greeting] {
                    if (const auto s = weak.lock()) greeting->open(*s);
                  }});
  return session;
}

void send_unsequenced(Session& session, const wire::Message& message) {
  session.send({{}, wire::encode(message)});
}

}  // namespace cloudrenderer
