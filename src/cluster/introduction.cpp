#include "cluster/introduction.h"

#include <variant>

#include "net/greeting.h"

namespace cloudrenderer {

const wire::Hello* hello_of(Session& session, const wire::Message& message) {
  const auto* hello = std::get_if<wire::Hello>(&message);
  if (hello == nullptr) session.close(std::string("it sent ") + wire::message_name(message) + " instead of Hello");
  return hello;
}

void refuse(Session& session, const wire::Hello& hello, const std::string& reason, const std::string& logged) {
  wire::Refused refused;
  refused.set_reason(reason);
  send_unsequenced(session, refused);
  session.close_when_sent("host " + hello.name() + " " + (logged.empty() ? "is refused: " + reason : logged));
}

}  // namespace cloudrenderer
