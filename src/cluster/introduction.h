#pragma once
#include <string>

#include "net/session.h"
#include "wire/messages.h"

namespace cloudrenderer {

// The first message of a host; null: it is another one, and the session is being closed.
const wire::Hello* hello_of(Session& session, const wire::Message& message);

// Tells a host that it is not taken, and closes the session once this is sent. `logged`: for our own log, the same if empty.
void refuse(Session& session, const wire::Hello& hello, const std::string& reason, const std::string& logged = "");

}  // namespace cloudrenderer
