// The payload of a message, as it came and with a checksum that fits.
#include "fuzz/sealed.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::Input bytes = fuzz::input(data, size);
  (void)wire::decode(bytes);
  const Result<wire::Message> message = wire::decode(fuzz::sealed_payload(bytes));
  if (!message) {
    fuzz::require(!message.error().empty(), "a refused message has a reason");
    return 0;
  }
  const wire::Bytes again = wire::encode(*message);
  const Result<wire::Message> twice = wire::decode(*again);
  fuzz::require(static_cast<bool>(twice), "what was accepted can be sent on");
  fuzz::require(twice->index() == message->index(), "a message keeps its type");
  return 0;
}
