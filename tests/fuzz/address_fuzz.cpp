#include "base/error.h"
#include "fuzz/fuzz.h"
#include "net/address.h"

using namespace cloudrenderer;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const Address a = Address::parse({reinterpret_cast<const char*>(data), size});
    fuzz::require(Address::parse(a.to_string()) == a, "an address can be written down");
    (void)a.is_loopback();
  } catch (const UsageError& e) {
    fuzz::require(*e.what() != '\0', "an error says what");
  }
  return 0;
}
