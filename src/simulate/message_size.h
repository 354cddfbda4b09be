#pragma once
#include "wire/messages.h"

namespace cloudrenderer::sim {

// Of what workers say to each other.
struct MessageSize {
  double bytes = 0, messages = 1;
  double moves = 0;  // segments and shadow rays in it
};
// Of the real messages that a simulated one stands for, with `weight` real paths a path. A real batch has `weight` times
// as many segments that leave (`per_batch` simulated ones), for the same hosts (`peers`): of n segments for T hosts,
// whichever they are, T (1 - exp(-n / T)) get some.
MessageSize size_of(const wire::Message& m, double weight, double per_batch, std::size_t peers);

// Pixels of an encoded reply of a renderer task; 0: it is none.
std::uint64_t reply_sums(const std::vector<std::byte>& payload);

}  // namespace cloudrenderer::sim
